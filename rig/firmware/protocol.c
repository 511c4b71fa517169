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
    case CONFIG_REQUEST: return 34;
    case ARM: return 7;
    case DISARM: return 1;
    case COMMAND: return 8;
    case PULSE_CONFIG_REQUEST: return 44;
    case PULSE_COMMAND: return 9;
    case CONFIG_ANSWER: return 18;
    case TELEMETRY: return 22;
    case TELEMETRY_WITH_TACHOMETER: return 26;
    case PULSE_TELEMETRY: return 16;
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

uint16_t get16(const uint8_t *p) { return (uint16_t)(p[0] | ((uint16_t)p[1] << 8)); }
uint32_t get32(const uint8_t *p) { return get16(p) | ((uint32_t)get16(p + 2) << 16); }
uint8_t *put16(uint8_t *p, uint16_t v) {
    p[0] = (uint8_t)v;
    p[1] = (uint8_t)(v >> 8);
    return p + 2;
}
uint8_t *put32(uint8_t *p, uint32_t v) {
    return put16(put16(p, (uint16_t)v), (uint16_t)(v >> 16));
}

uint8_t ring_room(uint8_t in, uint8_t out, uint8_t size) {
    return (uint8_t)((uint8_t)(out - in - 1) % size); /* int would keep the sign */
}

/* --- what each packet does --- */

static session_t *session_of(board_t *b) { return (session_t *)b; } /* its first member */

static uint32_t next_token(uint32_t seed) { return seed * (uint32_t)2654435761UL + 1; }

static void take_config(board_t *b, const uint8_t *p) {
    session_t *s = session_of(b);
    if (s->state == IS_LEVELLING || s->busy || kind_flies(b)) return;
    /* Armed without a command, another host's question is let in: ours died before its first word. */
    if (s->state == IS_ARMED && (s->commanded || get16(p + 2) == s->nonce)) return;
    s->nonce = get16(p + 2);
    s->answer_due = 1;
    s->state = IS_DISARMED;
    /* Where it refuses, the answer says which version and which kind it would have been. */
    s->configured = p[1] == PROTOCOL_VERSION && kind_config(b, p);
    if (!s->configured) return;
    s->period_ms = p[4] ? p[4] : 1;
    s->token = next_token(s->token ^ s->clock_us ^ ((uint32_t)s->nonce << 16)) | 1;
    s->reason = 0;
    s->since_telemetry_ms = 0;
}

static void take_arm(session_t *s, const uint8_t *p) {
    if (!s->configured || s->state != IS_DISARMED || get32(p + 1) != s->token) return;
    s->armed_by = s->token;
    s->token = next_token(s->token); /* it arms once */
    s->sequence = get16(p + 5);
    s->commanded = 0;
    s->age_ms = 0;
    s->reason = 0;
    s->state = IS_ARMED;
}

static void take_command(board_t *b, const uint8_t *p) {
    session_t *s = session_of(b);
    uint16_t sequence = get16(p + 1);
    int16_t newer = (int16_t)(uint16_t)(sequence - s->sequence);
    if (s->state != IS_ARMED || newer <= 0) return; /* doubled, overtaken or stale */
    if (!kind_command(b, p)) return;
    s->sequence = sequence;
    s->age_ms = 0;
    s->commanded = 1;
}

void board_byte(board_t *b, uint8_t byte) {
    session_t *s = session_of(b);
    uint8_t payload[LONGEST_FRAME];
    if (!parser_byte(&s->parser, byte, payload)) return;
    switch (payload[0]) {
    case CONFIG_REQUEST:
    case PULSE_CONFIG_REQUEST: take_config(b, payload); break;
    case ARM: take_arm(s, payload); break;
    case DISARM:
        if (s->state != IS_LATCHED) s->state = IS_DISARMED;
        break;
    case COMMAND:
    case PULSE_COMMAND: take_command(b, payload); break;
    default: break; /* an echo of our own */
    }
}

/* --- time --- */

void session_init(session_t *s) {
    memset(s, 0, sizeof *s);
    s->period_ms = 2;
    s->state = IS_DISARMED;
}

void session_stop(session_t *s, uint16_t reason, state_t state) {
    s->reason = reason;
    s->state = state;
    s->level_ms = 0;
}

static void watch(session_t *s) {
    s->age_ms++; /* looked at while armed alone, and then it is below UNUSED_MS */
    if (s->state == IS_LEVELLING && ++s->level_ms >= LEVEL_MS) s->state = IS_LATCHED;
    if (s->state == IS_ARMED && s->age_ms >= (s->commanded ? WATCHDOG_MS : UNUSED_MS))
        session_stop(s, BY_WATCHDOG, IS_LEVELLING);
}

void board_tick(board_t *b) {
    session_t *s = session_of(b);
    s->clock_us += 1000;
    watch(s);
    kind_tick(b);
    if (s->configured && ++s->since_telemetry_ms >= s->period_ms) {
        s->since_telemetry_ms = 0;
        s->telemetry_due = 1;
    }
}

void board_notice(board_t *b, uint16_t what) { session_of(b)->noticed |= what; }

/* --- what it says --- */

static uint8_t config_answer(board_t *b, uint8_t *p) {
    const session_t *s = session_of(b);
    uint8_t *begin = p;
    *p++ = CONFIG_ANSWER;
    *p++ = PROTOCOL_VERSION;
    p = put16(p, s->nonce);
    p = put32(p, s->token);
    p = put32(p, s->clock_us);
    *p++ = s->period_ms;
    p = kind_answer(b, p);
    if (!s->configured) p[-1] |= REFUSED;
    return (uint8_t)(p - begin);
}

static uint8_t telemetry(board_t *b, uint8_t *p) {
    session_t *s = session_of(b);
    uint8_t *begin = p;
    uint16_t f = s->reason | s->noticed;
    if (s->state == IS_ARMED) f |= ARMED;
    if (s->state == IS_LEVELLING) f |= LEVELLING;
    if (s->state == IS_LATCHED) f |= LATCHED;
    if (s->configured) f |= CONFIGURED;
    *p++ = kind_telemetry(b, &f);
    p = put32(p, s->clock_us);
    p = put16(p, s->sequence);
    p = put16(p, f);
    *p++ = s->parser.bad_frames;
    p = kind_outputs(b, p);
    s->noticed = 0;
    return (uint8_t)(p - begin);
}

uint8_t board_frame(board_t *b, uint8_t *frame) {
    session_t *s = session_of(b);
    uint8_t payload[LONGEST_PAYLOAD];
    if (s->answer_due) {
        s->answer_due = 0;
        return frame_encode(payload, config_answer(b, payload), frame);
    }
    if (s->telemetry_due) {
        s->telemetry_due = 0;
        return frame_encode(payload, telemetry(b, payload), frame);
    }
    return 0;
}
