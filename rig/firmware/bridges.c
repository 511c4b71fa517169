/* Registers of two H-bridges, two quadrature encoders and two tachometers; pins in README.md. All
 * that decides is in volts.c and protocol.c.
 */
#include <avr/interrupt.h>
#include <avr/io.h>

#include "chip.h"
#include "volts.h"

#ifndef SUPPLY_MV
#define SUPPLY_MV 12000 /* what feeds the H-bridges */
#endif
#define PWM_TOP 799 /* 20 kHz */

#if defined(__AVR_ATmega2560__)
#define ENCODERS PINK
#define ENCODERS_PORT PORTK
#define ENCODERS_MASK PCMSK2
#define ENCODERS_ENABLE _BV(PCIE2)
#define ENCODERS_vect PCINT2_vect
#define PWM_PINS (_BV(PB5) | _BV(PB6)) /* OC1A, OC1B: D11, D12 */
#define DIRECTION_DDR DDRH
#define DIRECTION_PORT PORTH
#define DIRECTION_0 _BV(PH3) /* D6 */
#define DIRECTION_1 _BV(PH4) /* D7 */
#define TACHOMETER_CHANNEL 0 /* A0, A1 */
#else
#define ENCODERS PINC
#define ENCODERS_PORT PORTC
#define ENCODERS_MASK PCMSK1
#define ENCODERS_ENABLE _BV(PCIE1)
#define ENCODERS_vect PCINT1_vect
#define PWM_PINS (_BV(PB1) | _BV(PB2)) /* OC1A, OC1B: D9, D10 */
#define DIRECTION_DDR DDRD
#define DIRECTION_PORT PORTD
#define DIRECTION_0 _BV(PD4) /* D4 */
#define DIRECTION_1 _BV(PD7) /* D7 */
#define TACHOMETER_CHANNEL 4 /* A4, A5 */
#endif

board_t board;
static volatile int32_t counts[2];

/* --- encoders: A and B of channel 0 on bits 0 and 1, of channel 1 on bits 2 and 3 --- */

/* +1, -1 or 0 by the old and the new two bits; a change of both at once is unreadable: 0. */
static const int8_t STEP[16] = {0, 1, -1, 0, -1, 0, 0, 1, 1, 0, 0, -1, 0, -1, 1, 0};

static uint8_t lines; /* as last seen */

ISR(ENCODERS_vect) {
    uint8_t is = ENCODERS & 0x0F;
    counts[0] += STEP[((lines & 3) << 2) | (is & 3)];
    counts[1] += STEP[(lines & 12) | (is >> 2)];
    lines = is;
}

static void encoders_start(void) {
    ENCODERS_PORT |= 0x0F; /* pull-ups: encoders with open collectors need them */
    ENCODERS_MASK = 0x0F;
    PCICR |= ENCODERS_ENABLE;
    PCIFR = 0xFF;
    lines = ENCODERS & 0x0F;
}

/* --- motors: pulse width and direction --- */

static void motors_start(void) {
    DDRB |= PWM_PINS;
    DIRECTION_DDR |= DIRECTION_0 | DIRECTION_1;
    ICR1 = PWM_TOP;
    TCCR1A = _BV(WGM11); /* fast PWM up to ICR1, both pins not connected: low */
    TCCR1B = _BV(WGM13) | _BV(WGM12) | _BV(CS10);
}

static void motor_set(uint8_t channel, int16_t mV) {
    uint16_t size = (uint16_t)(mV < 0 ? -mV : mV);
    uint16_t duty = (uint16_t)(((uint32_t)size * (PWM_TOP + 1) + SUPPLY_MV / 2) / SUPPLY_MV);
    uint8_t direction = channel ? DIRECTION_1 : DIRECTION_0;
    uint8_t connect = channel ? _BV(COM1B1) : _BV(COM1A1);
    if (duty > PWM_TOP + 1) duty = PWM_TOP + 1;
    if (mV < 0)
        DIRECTION_PORT |= direction;
    else
        DIRECTION_PORT &= (uint8_t)~direction;
    if (duty == 0) { /* fast PWM would leave a spike */
        TCCR1A &= (uint8_t)~connect;
        return;
    }
    if (channel)
        OCR1B = duty - 1;
    else
        OCR1A = duty - 1;
    TCCR1A |= connect;
}

/* --- tachometers: half the supply is standstill; one channel a tick --- */

#ifdef TACHOMETER
static void tachometer_read(void) {
    static uint8_t channel;
    board.tachometer_mV[channel] = (int16_t)((ADC - 512L) * 5000 / 1024);
    channel ^= 1;
    ADMUX = _BV(REFS0) | (TACHOMETER_CHANNEL + channel);
    ADCSRA = _BV(ADEN) | _BV(ADSC) | 7; /* 104 us: done long before the next tick */
}
#define TACHOMETERS 1
#else
#define TACHOMETERS 0
#endif

/* --- the chip's calls --- */

void outputs_start(void) {
    motors_start();
    encoders_start();
    board_init(&board, TACHOMETERS);
}

void inputs_read(void) {
    cli();
    board.counts[0] = counts[0];
    board.counts[1] = counts[1];
    sei();
#ifdef TACHOMETER
    tachometer_read();
#endif
}

void outputs_put(void) {
    motor_set(0, board.applied_mV[0]);
    motor_set(1, board.applied_mV[1]);
    chip_led(board.session.state == IS_ARMED);
}
