/* The chip's part: a 1 kHz tick, two H-bridges, two quadrature encoders, one UART.
 *
 * ATmega328P (Arduino Uno, Nano) or ATmega2560 (Arduino Mega) at 16 MHz; pins in README.md. All
 * that decides is in protocol.c; here are registers.
 */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#include "protocol.h"

#ifndef SUPPLY_MV
#define SUPPLY_MV 12000 /* what feeds the H-bridges */
#endif
#ifndef BAUD
#define BAUD 500000UL
#endif
#define PWM_TOP 799 /* 20 kHz */
#define UBRR_VALUE ((F_CPU / 8 + BAUD / 2) / BAUD - 1)

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
#define LED _BV(PB7)
#define RX_vect USART0_RX_vect
#define UDRE_vect USART0_UDRE_vect
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
#define LED _BV(PB5)
#define RX_vect USART_RX_vect
#define UDRE_vect USART_UDRE_vect
#define TACHOMETER_CHANNEL 4 /* A4, A5 */
#endif

static board_t board;
static volatile uint8_t ticks;
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
    DDRB |= PWM_PINS | LED;
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

/* --- serial line: rings filled and emptied by interrupts --- */

#define RX_SIZE 128
#define TX_SIZE 128
static volatile uint8_t rx[RX_SIZE], rx_in, rx_out, rx_lost;
static volatile uint8_t tx[TX_SIZE], tx_in, tx_out;

ISR(RX_vect) {
    uint8_t status = UCSR0A, byte = UDR0, next = (uint8_t)((rx_in + 1) % RX_SIZE);
    if (status & _BV(DOR0)) rx_lost = 1;
    if (status & _BV(FE0)) byte = 0; /* a broken byte ends its frame, which the CRC refuses */
    if (next == rx_out) {
        rx_lost = 1;
        return;
    }
    rx[rx_in] = byte;
    rx_in = next;
}

ISR(UDRE_vect) {
    if (tx_in == tx_out) {
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
        return;
    }
    UDR0 = tx[tx_out];
    tx_out = (uint8_t)((tx_out + 1) % TX_SIZE);
}

static void uart_start(void) {
    UCSR0A = _BV(U2X0);
    UBRR0 = UBRR_VALUE;
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
}

static void uart_receive(void) {
    while (rx_out != rx_in) {
        board_byte(&board, rx[rx_out]);
        rx_out = (uint8_t)((rx_out + 1) % RX_SIZE);
    }
    if (rx_lost) {
        rx_lost = 0;
        board.noticed |= BYTES_LOST;
    }
}

/* Send whole frames while there is room; what does not fit waits (telemetry: the newest). */
static void uart_send(void) {
    uint8_t frame[LONGEST_FRAME], length, i;
    while (ring_room(tx_in, tx_out, TX_SIZE) >= LONGEST_FRAME) {
        length = board_frame(&board, frame);
        if (length == 0) return;
        for (i = 0; i < length; i++) {
            tx[tx_in] = frame[i];
            tx_in = (uint8_t)((tx_in + 1) % TX_SIZE);
        }
        UCSR0B |= _BV(UDRIE0);
    }
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

/* --- the tick --- */

ISR(TIMER0_COMPA_vect) { ticks++; }

static void clock_start(void) {
    TCCR0A = _BV(WGM01);
    OCR0A = F_CPU / 64 / 1000 - 1;
    TIMSK0 = _BV(OCIE0A);
    TCCR0B = _BV(CS01) | _BV(CS00);
}

static void tick(void) {
    uint8_t passed;
    cli();
    passed = ticks;
    ticks = 0;
    board.counts[0] = counts[0];
    board.counts[1] = counts[1];
    sei();
    if (passed > 1) board.noticed |= LATE_TICK;
#ifdef TACHOMETER
    tachometer_read();
#endif
    while (passed--) { /* time limits count every millisecond, late or not */
        board.clock_us += 1000;
        board_tick(&board);
    }
    motor_set(0, board.applied_mV[0]);
    motor_set(1, board.applied_mV[1]);
    if (board.state == IS_ARMED)
        PORTB |= LED;
    else
        PORTB &= (uint8_t)~LED;
    wdt_reset();
}

int main(void) {
    MCUSR = 0;
    wdt_disable();
    motors_start();
    encoders_start();
    uart_start();
    board_init(&board, SUPPLY_MV, TACHOMETERS);
    clock_start();
    wdt_enable(WDTO_60MS); /* a hung program ends in a reset: pins low, disarmed */
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    for (;;) {
        uart_receive();
        if (ticks) tick();
        uart_send();
        cli();
        if (!ticks && rx_in == rx_out) {
            sleep_enable();
            sei();
            sleep_cpu();
            sleep_disable();
        }
        sei();
    }
}
