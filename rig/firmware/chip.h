/* The chip's part, of every board (chip.c) and of its own (bridges.c, servos.c). */
#ifndef CHIP_H
#define CHIP_H

#include "protocol.h"

/* Each board has: itself; pins and timers, set up with it; what it reads before a tick and puts out
 * after it. */
extern board_t board;
void outputs_start(void);
void inputs_read(void);
void outputs_put(void);

void chip_led(uint8_t is_lit);

#endif
