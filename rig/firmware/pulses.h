/* A board with hobby (RC) servos: which pulses are put out, and how fast they change.
 *
 * A servo holds the angle that its pulse tells and says nothing back. So pulses begin, with arming,
 * at the level angle, and the servo goes there from wherever it is as fast as it can.
 */
#ifndef PULSES_H
#define PULSES_H

#include "protocol.h"

#define MOST_SERVOS 3
/* The board's own bounds; the host may ask for less, never for more. Pulses in half us. */
#define SHORTEST_PULSE (2 * 500)
#define LONGEST_PULSE (2 * 2500) /* further, a servo stands at its stop and burns */
#define SHORTEST_FRAME_US 4000 /* the longest pulse, and a tick in which registers may change */
#define LONGEST_FRAME_US 20000
#define LEAST_RATE_MRAD_S 100 /* chosen, because a silent host's plate is level in 10 s at 1 rad */
#define MOST_ANGLE 31415 /* 0.1 mrad: no servo's arm turns further than half a turn to each side */

typedef struct {
    uint16_t level, lowest, highest; /* pulses [half us] */
    int16_t slope; /* 0.1 us/rad */
    int32_t limit_urad; /* of the angle, to each side */
    uint16_t rate; /* of the angle: mrad/s, or urad a ms */
} servo_t;

struct board {
    session_t session;
    uint8_t most; /* servos; constant after board_init */
    /* what the chip's part puts out after board_tick */
    uint16_t frame_us;          /* from pulse to pulse */
    uint16_t pulse[MOST_SERVOS]; /* half us; 0: none */
    /* configuration */
    uint8_t servos;
    servo_t servo[MOST_SERVOS];
    /* angles */
    int32_t wish_urad[MOST_SERVOS], at_urad[MOST_SERVOS];
    uint8_t limited;
};

void board_init(board_t *b, uint8_t most);

#endif
