#include "volts.h"

#include <string.h>

/* --- the host's packets --- */

static int32_t clamp(int32_t v, int32_t most) { return v > most ? most : v < -most ? -most : v; }

static int32_t least(int32_t a, int32_t b) { return a < b ? a : b; }

static __attribute__((noinline)) int32_t larger(int32_t a, int32_t b) { return a > b ? a : b; }

/* v / 2^times, towards zero: a division takes the chip a twentieth of a tick. (noinline, here and
 * above: the code is shorter by 140 bytes.) */
static __attribute__((noinline)) int32_t halved(int32_t v, uint8_t times) {
    return v < 0 ? -(int32_t)((uint32_t)-v >> times) : (int32_t)((uint32_t)v >> times);
}

uint8_t kind_config(board_t *b, const uint8_t *p) {
    uint16_t per_rev = get16(p + 14), most;
    uint8_t e;
    if (p[0] != CONFIG_REQUEST || per_rev < FEWEST_COUNTS || get16(p + 22) == 0) return 0;
    b->wired = p[5];
    b->zero[0] = (int32_t)get32(p + 6);
    b->zero[1] = (int32_t)get32(p + 10);
    most = (uint16_t)((uint32_t)per_rev * ANGLE_LIMIT_MRAD / 6283);
    b->angle_limit = get16(p + 16);
    if (b->angle_limit > most) b->angle_limit = most;
    b->limit_mV = get16(p + 18);
    if (b->limit_mV > LIMIT_MV) b->limit_mV = LIMIT_MV;
    b->gain = (uint16_t)(1407434UL / per_rev); /* 14 V/rad = 2 pi 14000/per_rev mV a count */
    b->time_constant_ms = get16(p + 20) ? get16(p + 20) : 1;
    /* A tick and a half; and more for a slow servo, which else swings across its limit: near it the
     * law is a spring of k = W/taper with damping (1 + k delay)/(2 sqrt(k tau)). */
    b->delay_half_ms = (uint16_t)(2 * FILTER_MS + 3 + b->time_constant_ms / 20);
    b->top_speed = (int32_t)((uint32_t)per_rev * get16(p + 22) / 24544) + 1; /* of mrad/s */
    b->free_gain = least(256L * 256 / LAG_PARTS * b->top_speed / larger(b->limit_mV, 1), 1000000L);
    b->taper = per_rev / 157 + 1;
    b->lag_share = (int16_t)(8192 / b->time_constant_ms);
    if (b->lag_share > 2048) b->lag_share = 2048;
    if (b->lag_share < 1) b->lag_share = 1;
    b->moved = per_rev / 524; /* 0.012 rad: an encoder whose plug is half out flickers */
    if (b->moved < MOVED_COUNTS) b->moved = MOVED_COUNTS;
    for (e = 0; e < 2; e++) {
        b->sure_mV[e][0] = (uint16_t)least(get16(p + 24 + 4 * e), STALL_MV);
        b->sure_mV[e][1] = (uint16_t)least(get16(p + 26 + 4 * e), STALL_MV);
    }
    b->push_limit = 500 * least(get16(p + 32), STALL_MV / 1000 * STALL_MS);
    memset(b->push, 0, sizeof b->push);
    b->lost = 0;
    b->catch_ms = 0;
    return 1;
}

uint8_t kind_command(board_t *b, const uint8_t *p) {
    if (p[0] != COMMAND) return 0;
    b->ttl_ms = p[3];
    b->wish_mV[0] = (int16_t)get16(p + 4);
    b->wish_mV[1] = (int16_t)get16(p + 6);
    return 1;
}

/* --- volts: all below is by encoder channel `e`; volts are raised where they raise counts --- */

static uint8_t motor_of(const board_t *b, uint8_t e) {
    return (uint8_t)((b->wired & WIRED_CROSSED) ? 1 - e : e);
}

static uint8_t is_negative(const board_t *b, uint8_t e) {
    return b->wired & (e ? WIRED_NEGATIVE_1 : WIRED_NEGATIVE_0);
}

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
static int32_t speed(const board_t *b, uint8_t e) { return halved(b->speed_sum[e], FILTER_HALVINGS); }

/* That of a motor which volts alone drive, as in the play of its gears, in counts/256 a ms. */
static int32_t free_speed(const board_t *b, uint8_t e) {
    return clamp(halved(halved(b->lagged[e], 8) * b->free_gain, 8), 256L * MOST_COUNTS);
}

static void measure_speed(board_t *b, uint8_t e) {
    uint8_t last = (uint8_t)((b->past_at + RATE_MS - 1) % RATE_MS);
    int32_t moved = (int32_t)((uint32_t)b->counts[e] - (uint32_t)b->past[e][last]);
    b->speed_sum[e] += 256 * clamp(moved, MOST_COUNTS) - speed(b, e);
}

/* Volts that bring the arm on towards +, at most: the law of rig/safety/limits.py, in counts.
 *
 * A servo with the time constant tau that goes at w and is braked stops after
 * w delay + tau w^2 / (2 W + w), W its top speed. What is left of the way to the limit is the room;
 * with less than the taper of it the bound falls in proportion, through 0 V at no room, to full
 * volts back. In the play of its gears the motor goes unseen: w is the larger of the speed that the
 * encoder shows and that which the volts give a free motor. */
static int32_t most_mV(const board_t *b, int32_t at, int32_t w) {
    int32_t room = (int32_t)b->angle_limit - at;
    if (w > 0) {
        int32_t stop;
        room -= (int32_t)((uint32_t)w * b->delay_half_ms / 512) + 1; /* rounded up */
        stop = (int32_t)((uint32_t)w * b->time_constant_ms / 256); /* or less: no slow division */
        if (room - 1 - stop >= b->taper) return b->limit_mV;
        stop = (int32_t)((uint32_t)w * (uint32_t)w / (uint32_t)(2 * b->top_speed + w));
        room -= (int32_t)((uint32_t)stop * b->time_constant_ms / 256) + 1;
    }
    if (room >= b->taper) return b->limit_mV;
    if (room <= -b->taper) return -(int32_t)b->limit_mV;
    return room * b->limit_mV / b->taper;
}

/* The wish within the board's own limits. */
static int32_t guarded_mV(const board_t *b, uint8_t e, int32_t wish) {
    int32_t at = place(b, e), w = speed(b, e), free = free_speed(b, e), most;
    if (!(b->wired & WIRED_HOMED)) return clamp(wish, least(HOMING_LIMIT_MV, b->limit_mV));
    wish = least(clamp(wish, b->limit_mV), most_mV(b, at, larger(w, free)));
    most = most_mV(b, -at, larger(-w, -free));
    return wish > -most ? wish : -most;
}

static uint8_t has_moved(const board_t *b, uint8_t e, int32_t from) {
    int32_t way = (int32_t)((uint32_t)b->counts[e] - (uint32_t)from);
    return way > b->moved || way < -b->moved;
}

static uint8_t stalled(board_t *b, uint8_t e) {
    int16_t v = b->applied_mV[motor_of(b, e)];
    int8_t sign = (int8_t)(v >= STALL_MV ? 1 : v <= -STALL_MV ? -1 : 0);
    if (sign == 0 || sign != b->stall_sign[e] || has_moved(b, e, b->stall_from[e])) {
        b->stall_ms[e] = 0;
        b->stall_from[e] = b->counts[e];
        b->stall_sign[e] = sign;
        return 0;
    }
    return ++b->stall_ms[e] >= STALL_MS;
}

/* Volts that must have moved an arm whose encoder shows no motion: the law of
 * rig/safety/motion_watch.py, in mV times 2 ms, as each arm is looked at in every second tick. */
static uint8_t still(board_t *b, uint8_t e) {
    int32_t v = b->applied_mV[motor_of(b, e)], lagged, *push = b->push[e];
    if (is_negative(b, e)) v = -v;
    b->lagged[e] += ((LAG_PARTS * v - b->lagged[e]) * b->lag_share) >> 12; /* no slow division */
    lagged = halved(b->lagged[e], LAG_HALVINGS);
    if (has_moved(b, e, b->still_from[e])) {
        b->still_from[e] = b->counts[e];
        push[0] = push[1] = 0;
        return 0;
    }
    push[0] += least(v, lagged) - b->sure_mV[e][0];
    push[1] += least(-v, -lagged) - b->sure_mV[e][1];
    if (push[0] < 0) push[0] = 0;
    if (push[1] < 0) push[1] = 0;
    return (b->wired & WIRED_HOMED) && (push[0] > b->push_limit || push[1] > b->push_limit);
}

static void guard(board_t *b) {
    session_t *s = &b->session;
    uint8_t e;
    int32_t runaway = (int32_t)b->angle_limit + b->angle_limit / 6;
    for (e = 0; e < 2; e++) {
        uint8_t is_still = (b->past_at & 1) == e && still(b, e); /* in turn: a tick is short */
        if (stalled(b, e) || is_still) {
            b->lost |= (uint8_t)(1 << e);
            if (s->state == IS_ARMED || s->state == IS_LEVELLING)
                session_stop(s, BY_STALL, IS_LATCHED);
        }
        if (s->state != IS_ARMED || !(b->wired & WIRED_HOMED)) continue;
        if (place(b, e) > runaway || place(b, e) < -runaway) {
            b->catch_ms = 0; /* its braking failed, or the encoder jumps: gently then */
            session_stop(s, BY_ANGLE, IS_LEVELLING);
        }
    }
}

/* Until an arm has had the time to coast to rest it is braked before its limit, whoever holds the
 * table: an arm in flight at 0 V flies on. */
static void keep_catching(board_t *b) {
    state_t state = b->session.state;
    if (state == IS_ARMED)
        b->catch_ms = LEVEL_MS + CATCH_TAUS * (uint32_t)b->time_constant_ms;
    else if (b->catch_ms)
        b->catch_ms--;
}

/* Volts that the session asks of the motor on encoder channel `e`. */
static int32_t wish_mV(const board_t *b, uint8_t e) {
    const session_t *s = &b->session;
    if (s->state == IS_LEVELLING) return level_mV(b, e);
    if (s->state != IS_ARMED || !s->commanded || b->expired) return 0;
    return is_negative(b, e) ? -b->wish_mV[motor_of(b, e)] : b->wish_mV[motor_of(b, e)];
}

static void apply(board_t *b) {
    session_t *s = &b->session;
    uint8_t e;
    b->expired = s->state == IS_ARMED && s->commanded && s->age_ms > b->ttl_ms;
    b->limited = s->busy = 0;
    for (e = 0; e < 2; e++) {
        int32_t wish = wish_mV(b, e), v = b->catch_ms ? guarded_mV(b, e, wish) : wish;
        if (b->lost & (1 << e)) v = 0;
        if (s->state == IS_ARMED) b->limited |= v != wish;
        else s->busy |= v != 0;
        b->applied_mV[motor_of(b, e)] = (int16_t)(is_negative(b, e) ? -v : v);
    }
}

/* --- the session's calls --- */

void board_init(board_t *b, uint8_t has_tachometer) {
    memset(b, 0, sizeof *b);
    session_init(&b->session);
    b->has_tachometer = has_tachometer;
}

static uint8_t flies(const board_t *b, int32_t at, int32_t w) {
    int32_t way = (int32_t)((uint32_t)larger(w, 0) * b->time_constant_ms / 128);
    return way && at + way > (int32_t)b->angle_limit;
}

/* Whether an arm, at 0 V, might pass its limit, its time constant twice the known. */
uint8_t kind_flies(const board_t *b) {
    uint8_t e;
    if (!b->catch_ms || !(b->wired & WIRED_HOMED)) return 0;
    for (e = 0; e < 2; e++) {
        int32_t at = place(b, e), w = speed(b, e), free = free_speed(b, e);
        if (flies(b, at, larger(w, free)) || flies(b, -at, larger(-w, -free))) return 1;
    }
    return 0;
}

void kind_tick(board_t *b) {
    uint8_t e;
    if (b->session.state == IS_ARMED && !(b->wired & WIRED_HOMED)) b->homing = b->session.armed_by;
    for (e = 0; e < 2; e++) measure_speed(b, e);
    keep_catching(b);
    guard(b);
    apply(b);
    for (e = 0; e < 2; e++) b->past[e][b->past_at] = b->counts[e];
    b->past_at = (uint8_t)((b->past_at + 1) % RATE_MS);
}

uint8_t *kind_answer(const board_t *b, uint8_t *p) {
    p = put32(p, b->homing);
    *p++ = b->has_tachometer ? HAS_TACHOMETER : 0;
    return p;
}

uint8_t kind_telemetry(const board_t *b, uint16_t *flags) {
    if (b->wired & WIRED_HOMED) *flags |= HOMED;
    if (b->limited) *flags |= LIMITED;
    if (b->expired) *flags |= EXPIRED;
    return b->has_tachometer ? TELEMETRY_WITH_TACHOMETER : TELEMETRY;
}

uint8_t *kind_outputs(const board_t *b, uint8_t *p) {
    p = put32(p, (uint32_t)b->counts[0]);
    p = put32(p, (uint32_t)b->counts[1]);
    p = put16(p, (uint16_t)b->applied_mV[0]);
    p = put16(p, (uint16_t)b->applied_mV[1]);
    if (b->has_tachometer) {
        p = put16(p, (uint16_t)b->tachometer_mV[0]);
        p = put16(p, (uint16_t)b->tachometer_mV[1]);
    }
    return p;
}
