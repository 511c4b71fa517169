#include "protocol.h"

#include <string.h>

/* --- frames --- */

static uint16_t crc_update(uint16_t crc, uint8_t byte) {
    uint8_t i;
    crc ^= (uint16_t)((uint16_t)byte << 8);
    for (i = 0; i < 8; i++)
        crc = (uint16_t)((crc & 0x8000u) ? (uint16_t)(crc << 1) ^ 0x1021u : (uint16_t)(crc << 1));
    return crc;
}

static uint16_t crc_of(const uint8_t *data, uint8_t length) {
    uint16_t crc = 0xFFFF;
    while (length--) crc = crc_update(crc, *data++);
    return crc;
}

static uint8_t expected_length(uint8_t kind) {
    switch (kind) {
    case CONFIG_REQUEST: return 24;
    case ARM: return 7;
    case DISARM: return 1;
    case COMMAND: return 8;
    case CONFIG_ANSWER: return 18;
    case TELEMETRY: return 22;
    case TELEMETRY_WITH_TACHOMETER: return 26;
    default: return 0;
    }
}

/* Undo the stuffing of `length` bytes (no zero among them); 0xFF where it is none. */
static uint8_t uncobs(const uint8_t *in, uint8_t length, uint8_t *out) {
    uint8_t i = 0, n = 0, k;
    while (i < length) {
        uint8_t code = in[i];
        if (code == 0 || (uint16_t)i + code > length) return 0xFF;
        for (k = 1; k < code; k++) out[n++] = in[i + k];
        i = (uint8_t)(i + code);
        if (i < length) out[n++] = 0;
    }
    return n;
}

uint8_t parser_byte(parser_t *p, uint8_t byte, uint8_t *payload) {
    uint8_t n, length = p->length;
    if (byte != 0) {
        if (length < LONGEST_FRAME) p->frame[p->length++] = byte;
        return 0;
    }
    p->length = 0;
    if (length == 0) return 0; /* zeros between frames mean nothing */
    n = length < LONGEST_FRAME ? uncobs(p->frame, length, payload) : 0xFF;
    if (n != 0xFF && n >= 3 && n - 2 == expected_length(payload[0])) {
        uint16_t sent = (uint16_t)(payload[n - 2] | ((uint16_t)payload[n - 1] << 8));
        if (crc_of(payload, (uint8_t)(n - 2)) == sent) return (uint8_t)(n - 2);
    }
    p->bad_frames++;
    return 0;
}

uint8_t frame_encode(const uint8_t *payload, uint8_t length, uint8_t *frame) {
    uint16_t crc = crc_of(payload, length);
    uint8_t i, n = 1, mark = 0, code = 1;
    for (i = 0; i < length + 2; i++) {
        uint8_t byte = i < length ? payload[i] : (uint8_t)(i == length ? crc : crc >> 8);
        if (byte) {
            frame[n++] = byte;
            code++;
        } else {
            frame[mark] = code;
            mark = n++;
            code = 1;
        }
    }
    frame[mark] = code;
    frame[n++] = 0;
    return n;
}

/* --- numbers in payloads --- */

static uint16_t get16(const uint8_t *p) { return (uint16_t)(p[0] | ((uint16_t)p[1] << 8)); }
static uint32_t get32(const uint8_t *p) { return get16(p) | ((uint32_t)get16(p + 2) << 16); }
static uint8_t *put16(uint8_t *p, uint16_t v) {
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
    return p + 2;
}
static uint8_t *put32(uint8_t *p, uint32_t v) {
    return put16(put16(p, (uint16_t)v), (uint16_t)(v >> 16));
}

/* --- what each packet does --- */

static uint32_t next_token(uint32_t seed) { return seed * (uint32_t)2654435761UL + 1; }

uint8_t ring_room(uint8_t in, uint8_t out, uint8_t size) {
    return (uint8_t)((uint8_t)(out - in - 1) % size); /* int would keep the sign */
}

static void take_config(board_t *b, const uint8_t *p) {
    uint16_t per_rev = get16(p + 14), most;
    if (b->state == IS_LEVELLING) return;
    /* Armed without a command, another host's question is let in: ours died before its first word. */
    if (b->state == IS_ARMED && (b->commanded || get16(p + 2) == b->nonce)) return;
    b->nonce = get16(p + 2);
    b->answer_due = 1;
    if (p[1] != PROTOCOL_VERSION || per_rev < FEWEST_COUNTS || get16(p + 22) == 0) {
        b->configured = 0; /* the answer says which version it would have been */
        b->state = IS_DISARMED;
        return;
    }
    b->period_ms = p[4] ? p[4] : 1;
    b->wired = p[5];
    if (!(p[5] & WIRED_HOMED)) b->fresh = 0; /* it is about to be homed */
    b->zero[0] = (int32_t)get32(p + 6);
    b->zero[1] = (int32_t)get32(p + 10);
    most = (uint16_t)((uint32_t)per_rev * ANGLE_LIMIT_MRAD / 6283);
    b->angle_limit = get16(p + 16);
    if (b->angle_limit > most) b->angle_limit = most;
    b->limit_mV = get16(p + 18);
    if (b->limit_mV > LIMIT_MV) b->limit_mV = LIMIT_MV;
    b->gain = (uint16_t)(1407434UL / per_rev); /* 14 V/rad = 2 pi 14000/per_rev mV a count */
    b->time_constant_ms = get16(p + 20);
    /* A tick and a half; and more for a slow servo, which else swings across its limit: near it the
     * law is a spring of k = W/taper with damping (1 + k delay)/(2 sqrt(k tau)). */
    b->delay_half_ms = (uint16_t)(2 * FILTER_MS + 3 + b->time_constant_ms / 20);
    b->top_speed = (int32_t)((uint32_t)per_rev * get16(p + 22) / 24544) + 1; /* of mrad/s */
    b->taper = per_rev / 157 + 1;
    b->token = next_token(b->token ^ b->clock_us ^ ((uint32_t)b->nonce << 16));
    b->configured = 1;
    b->state = IS_DISARMED;
    b->reason = 0;
    b->since_telemetry_ms = 0;
}

static void take_arm(board_t *b, const uint8_t *p) {
    if (!b->configured || b->state != IS_DISARMED || get32(p + 1) != b->token) return;
    b->token = next_token(b->token); /* it arms once */
    b->sequence = get16(p + 5);
    b->commanded = 0;
    b->age_ms = 0;
    b->reason = 0;
    b->state = IS_ARMED;
}

static void take_command(board_t *b, const uint8_t *p) {
    uint16_t sequence = get16(p + 1);
    int16_t newer = (int16_t)(uint16_t)(sequence - b->sequence);
    if (b->state != IS_ARMED || newer <= 0) return; /* doubled, overtaken or stale */
    b->sequence = sequence;
    b->ttl_ms = p[3];
    b->wish_mV[0] = (int16_t)get16(p + 4);
    b->wish_mV[1] = (int16_t)get16(p + 6);
    b->age_ms = 0;
    b->commanded = 1;
}

void board_byte(board_t *b, uint8_t byte) {
    uint8_t payload[LONGEST_FRAME];
    if (!parser_byte(&b->parser, byte, payload)) return;
    switch (payload[0]) {
    case CONFIG_REQUEST: take_config(b, payload); break;
    case ARM: take_arm(b, payload); break;
    case DISARM:
        if (b->state != IS_LATCHED) b->state = IS_DISARMED;
        break;
    case COMMAND: take_command(b, payload); break;
    default: break; /* an echo of our own */
    }
}

/* --- volts: all below is by encoder channel `e`; volts are raised where they raise counts --- */

static uint8_t motor_of(const board_t *b, uint8_t e) {
    return (uint8_t)((b->wired & WIRED_CROSSED) ? 1 - e : e);
}

static int32_t clamp(int32_t v, int32_t most) { return v > most ? most : v < -most ? -most : v; }

static int32_t least(int32_t a, int32_t b) { return a < b ? a : b; }

/* Position from level and speed (counts in RATE_MS), without overflow whatever was counted. */
static int32_t place(const board_t *b, uint8_t e) {
    return clamp((int32_t)((uint32_t)b->counts[e] - (uint32_t)b->zero[e]), 100000);
}
static int32_t rate(const board_t *b, uint8_t e) {
    return clamp((int32_t)((uint32_t)b->counts[e] - (uint32_t)b->past[e][b->past_at]), 10000);
}

static int32_t level_mV(const board_t *b, uint8_t e) {
    int32_t most = least(LEVEL_LIMIT_MV, b->limit_mV);
    if (!(b->wired & WIRED_HOMED)) return 0; /* it does not know where level is */
    return clamp(-((int32_t)b->gain * clamp(place(b, e) + rate(b, e), 32000)) / 16, most);
}

/* Filtered speed in counts/256 a ms. */
static int32_t speed(const board_t *b, uint8_t e) { return b->speed_sum[e] / FILTER_MS; }

static void measure_speed(board_t *b, uint8_t e) {
    uint8_t last = (uint8_t)((b->past_at + RATE_MS - 1) % RATE_MS);
    int32_t moved = clamp((int32_t)((uint32_t)b->counts[e] - (uint32_t)b->past[e][last]), 100);
    b->speed_sum[e] += 256 * moved - speed(b, e);
}

/* Volts that bring the arm on towards +, at most: the law of rig/safety/limits.py, in counts.
 *
 * A servo with the time constant tau that goes at w and is braked stops after
 * w delay + tau w^2 / (2 W + w), W its top speed. What is left of the way to the limit is the room;
 * with less than the taper of it the bound falls in proportion, through 0 V at no room, to full
 * volts back. */
static int32_t most_mV(const board_t *b, int32_t at, int32_t w) {
    int32_t room = (int32_t)b->angle_limit - at;
    if (w > 0) {
        int32_t stop = (int32_t)((uint32_t)w * (uint32_t)w / (uint32_t)(2 * b->top_speed + w));
        room -= w * b->delay_half_ms / 512 + 1; /* rounded up */
        room -= (int32_t)((uint32_t)stop * b->time_constant_ms / 256) + 1;
    }
    if (room >= b->taper) return b->limit_mV;
    if (room <= -b->taper) return -(int32_t)b->limit_mV;
    return room * b->limit_mV / b->taper;
}

/* The wish within the board's own limits. */
static int32_t guarded_mV(const board_t *b, uint8_t e, int32_t wish) {
    int32_t at = place(b, e), w = speed(b, e), most;
    if (!(b->wired & WIRED_HOMED)) return clamp(wish, least(HOMING_LIMIT_MV, b->limit_mV));
    wish = least(clamp(wish, b->limit_mV), most_mV(b, at, w));
    most = most_mV(b, -at, -w);
    return wish > -most ? wish : -most;
}

static void stop(board_t *b, uint16_t reason, state_t state) {
    b->reason = reason;
    b->state = state;
    b->level_ms = 0;
}

static uint8_t stalled(board_t *b, uint8_t e) {
    int16_t v = b->applied_mV[motor_of(b, e)];
    int8_t sign = (int8_t)(v >= STALL_MV ? 1 : v <= -STALL_MV ? -1 : 0);
    int32_t moved = clamp((int32_t)((uint32_t)b->counts[e] - (uint32_t)b->stall_from[e]), 100);
    if (sign == 0 || sign != b->stall_sign[e] || moved > STALL_COUNTS || moved < -STALL_COUNTS) {
        b->stall_ms[e] = 0;
        b->stall_from[e] = b->counts[e];
        b->stall_sign[e] = sign;
        return 0;
    }
    return ++b->stall_ms[e] >= STALL_MS;
}

static void watch(board_t *b) {
    uint8_t e;
    int32_t runaway = (int32_t)b->angle_limit + b->angle_limit / 6;
    b->age_ms++; /* looked at while armed alone, and then it is below UNUSED_MS */
    if (b->state == IS_LEVELLING && ++b->level_ms >= LEVEL_MS) b->state = IS_LATCHED;
    for (e = 0; e < 2; e++) {
        uint8_t stall = stalled(b, e);
        if (b->state != IS_ARMED && b->state != IS_LEVELLING) continue;
        if (stall) stop(b, BY_STALL, IS_LATCHED);
        if (b->state != IS_ARMED || !(b->wired & WIRED_HOMED)) continue;
        if (place(b, e) > runaway || place(b, e) < -runaway) stop(b, BY_ANGLE, IS_LEVELLING);
    }
    if (b->state == IS_ARMED && b->age_ms >= (b->commanded ? WATCHDOG_MS : UNUSED_MS))
        stop(b, BY_WATCHDOG, IS_LEVELLING);
}

static void apply(board_t *b) {
    uint8_t e;
    b->expired = b->state == IS_ARMED && b->commanded && b->age_ms > b->ttl_ms;
    b->limited = 0;
    for (e = 0; e < 2; e++) {
        uint8_t m = motor_of(b, e);
        uint8_t negative = b->wired & (e ? WIRED_NEGATIVE_1 : WIRED_NEGATIVE_0);
        int32_t wish = b->commanded && !b->expired ? b->wish_mV[m] : 0, v = 0;
        if (negative) wish = -wish;
        if (b->state == IS_ARMED) {
            v = guarded_mV(b, e, wish);
            b->limited |= v != wish;
        } else if (b->state == IS_LEVELLING) {
            v = level_mV(b, e);
        }
        b->applied_mV[m] = (int16_t)(negative ? -v : v);
    }
}

/* --- the chip's calls --- */

void board_init(board_t *b, uint16_t supply_mV, uint8_t has_tachometer) {
    memset(b, 0, sizeof *b);
    b->supply_mV = supply_mV;
    b->has_tachometer = has_tachometer;
    b->period_ms = 2;
    b->fresh = 1;
    b->state = IS_DISARMED;
}

void board_tick(board_t *b) {
    uint8_t e;
    for (e = 0; e < 2; e++) measure_speed(b, e);
    watch(b);
    apply(b);
    for (e = 0; e < 2; e++) b->past[e][b->past_at] = b->counts[e];
    b->past_at = (uint8_t)((b->past_at + 1) % RATE_MS);
    if (b->configured && ++b->since_telemetry_ms >= b->period_ms) {
        b->since_telemetry_ms = 0;
        b->telemetry_due = 1;
    }
}

static uint8_t config_answer(const board_t *b, uint8_t *p) {
    uint8_t *begin = p;
    *p++ = CONFIG_ANSWER;
    *p++ = PROTOCOL_VERSION;
    p = put16(p, b->nonce);
    p = put32(p, b->token);
    p = put32(p, b->clock_us);
    *p++ = b->period_ms;
    p = put16(p, b->supply_mV);
    p = put16(p, b->limit_mV);
    *p++ = (uint8_t)((b->has_tachometer ? HAS_TACHOMETER : 0) | (b->fresh ? IS_FRESH : 0));
    return (uint8_t)(p - begin);
}

static uint16_t flags(const board_t *b) {
    uint16_t f = b->reason | b->noticed;
    if (b->state == IS_ARMED) f |= ARMED;
    if (b->state == IS_LEVELLING) f |= LEVELLING;
    if (b->state == IS_LATCHED) f |= LATCHED;
    if (b->configured) f |= CONFIGURED;
    if (b->wired & WIRED_HOMED) f |= HOMED;
    if (b->limited) f |= LIMITED;
    if (b->expired) f |= EXPIRED;
    return f;
}

static uint8_t telemetry(board_t *b, uint8_t *p) {
    uint8_t *begin = p;
    *p++ = b->has_tachometer ? TELEMETRY_WITH_TACHOMETER : TELEMETRY;
    p = put32(p, b->clock_us);
    p = put16(p, b->sequence);
    p = put16(p, flags(b));
    *p++ = b->parser.bad_frames;
    p = put32(p, (uint32_t)b->counts[0]);
    p = put32(p, (uint32_t)b->counts[1]);
    p = put16(p, (uint16_t)b->applied_mV[0]);
    p = put16(p, (uint16_t)b->applied_mV[1]);
    if (b->has_tachometer) {
        p = put16(p, (uint16_t)b->tachometer_mV[0]);
        p = put16(p, (uint16_t)b->tachometer_mV[1]);
    }
    b->noticed = 0;
    return (uint8_t)(p - begin);
}

uint8_t board_frame(board_t *b, uint8_t *frame) {
    uint8_t payload[LONGEST_PAYLOAD];
    if (b->answer_due) {
        b->answer_due = 0;
        return frame_encode(payload, config_answer(b, payload), frame);
    }
    if (b->telemetry_due) {
        b->telemetry_due = 0;
        return frame_encode(payload, telemetry(b, payload), frame);
    }
    return 0;
}
