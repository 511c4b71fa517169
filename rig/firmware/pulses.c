#include "pulses.h"

#include <string.h>

static int32_t clamp(int32_t v, int32_t most) { return v > most ? most : v < -most ? -most : v; }

/* The pulse of an angle [half us], the one place where angles become pulses: 0.1 us/rad times
 * 0.1 mrad is 1e-5 us, rounded to the nearest. */
static int32_t pulse_of(const servo_t *servo, int32_t urad) {
    int32_t turned = servo->slope * (urad / 100);
    return servo->level + (turned + (turned < 0 ? -25000 : 25000)) / 50000;
}

static uint8_t in_range(const servo_t *servo, int32_t pulse) {
    return servo->lowest <= pulse && pulse <= servo->highest;
}

/* Take a servo's 12 bytes; returns whether every angle up to its limit has a pulse in its range. */
static uint8_t take_servo(servo_t *servo, const uint8_t *p) {
    uint16_t limit = get16(p + 8);
    servo->level = get16(p);
    servo->slope = (int16_t)get16(p + 2);
    servo->lowest = get16(p + 4);
    servo->highest = get16(p + 6);
    servo->limit_urad = 100L * limit;
    servo->rate = get16(p + 10);
    if (servo->lowest < SHORTEST_PULSE || servo->highest > LONGEST_PULSE) return 0;
    if (servo->slope == 0 || limit > MOST_ANGLE || servo->rate < LEAST_RATE_MRAD_S) return 0;
    return in_range(servo, pulse_of(servo, servo->limit_urad)) &&
           in_range(servo, pulse_of(servo, -servo->limit_urad));
}

/* --- the session's calls --- */

void board_init(board_t *b, uint8_t most) {
    memset(b, 0, sizeof *b);
    session_init(&b->session);
    b->most = most;
    b->frame_us = LONGEST_FRAME_US;
}

uint8_t kind_config(board_t *b, const uint8_t *p) {
    uint16_t frame_us = get16(p + 6);
    uint8_t i;
    if (p[0] != PULSE_CONFIG_REQUEST || p[5] == 0 || p[5] > b->most) return 0;
    if (frame_us < SHORTEST_FRAME_US || frame_us > LONGEST_FRAME_US) return 0;
    for (i = 0; i < p[5]; i++)
        if (!take_servo(&b->servo[i], p + 8 + 12 * i)) return 0;
    b->servos = p[5];
    b->frame_us = frame_us;
    return 1;
}

uint8_t kind_command(board_t *b, const uint8_t *p) {
    uint8_t i;
    if (p[0] != PULSE_COMMAND) return 0;
    for (i = 0; i < MOST_SERVOS; i++) b->wish_urad[i] = 100L * (int16_t)get16(p + 3 + 2 * i);
    return 1;
}

uint8_t kind_flies(const board_t *b) {
    (void)b; /* a servo holds its angle by itself */
    return 0;
}

/* Told angles go to the wish at the servo's rate; levelling ends LEVEL_MS after they got there. */
void kind_tick(board_t *b) {
    session_t *s = &b->session;
    uint8_t i, is_on = s->state == IS_ARMED || s->state == IS_LEVELLING;
    b->limited = 0;
    for (i = 0; i < MOST_SERVOS; i++) {
        const servo_t *servo = &b->servo[i];
        int32_t wish = s->state == IS_ARMED && s->commanded ? b->wish_urad[i] : 0, step;
        if (!is_on || i >= b->servos) {
            b->at_urad[i] = 0;
            b->pulse[i] = 0;
            continue;
        }
        step = clamp(wish, servo->limit_urad) - b->at_urad[i];
        b->at_urad[i] += clamp(step, servo->rate);
        b->limited |= b->at_urad[i] != wish;
        b->pulse[i] = (uint16_t)pulse_of(servo, b->at_urad[i]);
        if (s->state == IS_LEVELLING && b->at_urad[i] != 0) s->level_ms = 0;
    }
}

uint8_t *kind_answer(const board_t *b, uint8_t *p) {
    p = put32(p, 0); /* no zero that a homing has to find */
    *p++ = (uint8_t)(TAKES_ANGLE | (b->most == MOST_SERVOS ? HAS_THREE : 0));
    return p;
}

uint8_t kind_telemetry(const board_t *b, uint16_t *flags) {
    if (b->limited) *flags |= LIMITED;
    return PULSE_TELEMETRY;
}

uint8_t *kind_outputs(const board_t *b, uint8_t *p) {
    uint8_t i;
    for (i = 0; i < MOST_SERVOS; i++) p = put16(p, b->pulse[i]);
    return p;
}
