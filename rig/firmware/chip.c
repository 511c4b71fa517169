/* What every board's chip does: a 1 kHz tick, one UART, the watchdog, sleep between.
 *
 * ATmega328P (Arduino Uno, Nano) or ATmega2560 (Arduino Mega) at 16 MHz.
 */
#include "chip.h"

#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#ifndef BAUD
#define BAUD 500000UL
#endif
#define UBRR_VALUE ((F_CPU / 8 + BAUD / 2) / BAUD - 1)

#if defined(__AVR_ATmega2560__)
#define LED _BV(PB7)
#define RX_vect USART0_RX_vect
#define UDRE_vect USART0_UDRE_vect
#else
#define LED _BV(PB5)
#define RX_vect USART_RX_vect
#define UDRE_vect USART_UDRE_vect
#endif

static volatile uint8_t ticks;

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

/* What has come, until the next tick is due: a host that never pauses delays none. */
static void uart_receive(void) {
    while (rx_out != rx_in && !ticks) {
        board_byte(&board, rx[rx_out]);
        rx_out = (uint8_t)((rx_out + 1) % RX_SIZE);
    }
    if (rx_lost) {
        rx_lost = 0;
        board_notice(&board, BYTES_LOST);
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

/* --- the tick --- */

ISR(TIMER0_COMPA_vect) { ticks++; }

static void clock_start(void) {
    TCCR0A = _BV(WGM01);
    OCR0A = F_CPU / 64 / 1000 - 1;
    TIMSK0 = _BV(OCIE0A);
    TCCR0B = _BV(CS01) | _BV(CS00);
}

void chip_led(uint8_t is_lit) {
    if (is_lit)
        PORTB |= LED;
    else
        PORTB &= (uint8_t)~LED;
}

static void tick(void) {
    uint8_t passed;
    cli();
    passed = ticks;
    ticks = 0;
    sei();
    if (passed > 1) board_notice(&board, LATE_TICK);
    inputs_read();
    while (passed--) board_tick(&board); /* time limits count every millisecond, late or not */
    outputs_put();
    wdt_reset();
}

int main(void) {
    MCUSR = 0;
    wdt_disable();
    DDRB |= LED;
    outputs_start();
    uart_start();
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
