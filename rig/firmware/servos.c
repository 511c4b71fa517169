/* Registers of two or three servo pulses, timed by one 16-bit timer; pins in README.md. All that
 * decides is in pulses.c and protocol.c.
 *
 * Fast PWM up to ICR at 2 MHz: the timer raises the pins at its bottom and lowers each at its
 * compare register, so no interrupt can move an edge. Registers change only after the longest pulse
 * and before the frame's end: no pulse is cut, and a changed one is out with the next frame.
 */
#include <avr/interrupt.h>
#include <avr/io.h>

#include "chip.h"
#include "pulses.h"

#if defined(__AVR_ATmega2560__) /* timer 4: OC1C of timer 1 is the LED's pin, which boot loaders blink */
#define SERVOS 3
#define PINS (_BV(PH3) | _BV(PH4) | _BV(PH5)) /* D6, D7, D8 */
#define PINS_DDR DDRH
#define CONTROL_A TCCR4A
#define CONTROL_B TCCR4B
#define COUNTER TCNT4
#define TOP ICR4
#define COMPARE_A OCR4A
#define COMPARE_B OCR4B
#define COMPARE_C OCR4C
#else
#define SERVOS 2
#define PINS (_BV(PB1) | _BV(PB2)) /* D9, D10 */
#define PINS_DDR DDRB
#define CONTROL_A TCCR1A
#define CONTROL_B TCCR1B
#define COUNTER TCNT1
#define TOP ICR1
#define COMPARE_A OCR1A
#define COMPARE_B OCR1B
#endif
#define FAST_PWM_A _BV(WGM11)
#define FAST_PWM_B (_BV(WGM13) | _BV(WGM12))
#define EIGHTH _BV(CS11) /* 2 MHz: half a us */
#define NEARLY_TOP 40    /* half us: longer than changing the registers takes */

board_t board;

void outputs_start(void) {
    PINS_DDR |= PINS; /* low */
    board_init(&board, SERVOS);
    TOP = 2U * LONGEST_FRAME_US - 1;
    CONTROL_A = FAST_PWM_A; /* no pin connected: low */
    CONTROL_B = FAST_PWM_B | EIGHTH;
}

void inputs_read(void) {}

static void frame_set(uint16_t top) {
    CONTROL_A = FAST_PWM_A; /* no pin connected, */
    CONTROL_B = FAST_PWM_B; /* and the clock stands */
    TOP = top;
    COUNTER = 0;
    CONTROL_B = FAST_PWM_B | EIGHTH;
}

static void pulses_set(void) {
    uint8_t connect = FAST_PWM_A;
    if (board.pulse[0]) connect |= _BV(COM1A1), COMPARE_A = board.pulse[0] - 1;
    if (board.pulse[1]) connect |= _BV(COM1B1), COMPARE_B = board.pulse[1] - 1;
#if SERVOS == 3
    if (board.pulse[2]) connect |= _BV(COM1C1), COMPARE_C = board.pulse[2] - 1;
#endif
    CONTROL_A = connect;
}

void outputs_put(void) {
    uint16_t top = 2U * board.frame_us - 1;
    cli();
    if (COUNTER > LONGEST_PULSE && COUNTER < TOP - NEARLY_TOP) {
        if (top != TOP) frame_set(top);
        pulses_set();
        chip_led(board.session.state == IS_ARMED);
    }
    sei();
}
