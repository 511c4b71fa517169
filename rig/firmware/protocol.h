/* What every board does, free of the chip and of what it drives: frames in and out, who may arm it,
 * when it stops.
 *
 * Twin of rig/hardware/board/wire.py (byte for byte). A kind of board (volts.c: H-bridges, pulses.c:
 * servo pulses) supplies the functions at the end. The chip's part feeds received bytes to
 * board_byte(), calls board_tick() once a millisecond, puts out what the kind says and sends the
 * frames that board_frame() gives. The same files are built for the host to be fuzzed.
 */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdint.h>

#define PROTOCOL_VERSION 4
#define LONGEST_FRAME 64 /* the closing zero included */
#define LONGEST_PAYLOAD (LONGEST_FRAME - 4)

enum {
    CONFIG_REQUEST = 0x01,
    ARM = 0x02,
    DISARM = 0x03,
    COMMAND = 0x04,
    PULSE_CONFIG_REQUEST = 0x05,
    PULSE_COMMAND = 0x06,
    CONFIG_ANSWER = 0x11,
    TELEMETRY = 0x12,
    TELEMETRY_WITH_TACHOMETER = 0x13,
    PULSE_TELEMETRY = 0x14
};

enum { /* flags of a telemetry packet */
    ARMED = 0x01,
    LEVELLING = 0x02,
    LATCHED = 0x04,
    CONFIGURED = 0x08,
    BY_WATCHDOG = 0x10,
    BY_ANGLE = 0x20,
    BY_STALL = 0x40,
    HOMED = 0x80,
    LIMITED = 0x100,
    EXPIRED = 0x200,
    LATE_TICK = 0x400,
    BYTES_LOST = 0x800
};

enum { /* features in an answer */
    HAS_TACHOMETER = 1,
    TAKES_ANGLE = 4,
    HAS_THREE = 8, /* servos */
    REFUSED = 16   /* what it was asked: it is not configured */
};

/* The board's own bounds; the host may ask for less, never for more. */
#ifndef WATCHDOG_MS
#define WATCHDOG_MS 100
#endif
#ifndef LEVEL_MS
#define LEVEL_MS 500
#endif
#define UNUSED_MS 5000 /* armed, and no command ever came */

typedef struct {
    uint8_t frame[LONGEST_FRAME];
    uint8_t length; /* LONGEST_FRAME: too long, dropped up to the next zero */
    uint8_t bad_frames;
} parser_t;

/* Feed one byte. Returns the payload's length when it completes a good packet (`payload`, of
 * LONGEST_FRAME bytes, then holds it, kind first), else 0. */
uint8_t parser_byte(parser_t *p, uint8_t byte, uint8_t *payload);

/* Frame `length` bytes of payload (at most LONGEST_PAYLOAD) into `frame`; returns its length. */
uint8_t frame_encode(const uint8_t *payload, uint8_t length, uint8_t *frame);

/* Numbers in payloads, little-endian; a put returns where the next one goes. */
uint16_t get16(const uint8_t *p);
uint32_t get32(const uint8_t *p);
uint8_t *put16(uint8_t *p, uint16_t v);
uint8_t *put32(uint8_t *p, uint32_t v);

typedef enum { IS_DISARMED, IS_ARMED, IS_LEVELLING, IS_LATCHED } state_t;

/* What a board knows of its host. */
typedef struct {
    uint32_t clock_us;
    uint16_t noticed; /* LATE_TICK, BYTES_LOST: told in the next telemetry, then cleared */
    parser_t parser;
    state_t state;
    uint8_t busy; /* what it drives is brought to rest: no host configures it meanwhile */
    uint16_t reason; /* BY_... of the last stop */
    uint8_t configured, period_ms;
    uint32_t token; /* what arms it once; never 0 after a configuration */
    uint32_t armed_by; /* the token of the last arming */
    uint16_t nonce;
    uint8_t commanded; /* since arming */
    uint16_t sequence;
    uint16_t age_ms; /* of the last fresh command (or of arming) */
    uint16_t level_ms;
    uint8_t answer_due, telemetry_due, since_telemetry_ms;
} session_t;

/* A board of any kind; its first member is its session_t. volts.h and pulses.h say the rest. */
typedef struct board board_t;

void session_init(session_t *s);
/* Why the host is not obeyed any more, and what comes now. */
void session_stop(session_t *s, uint16_t reason, state_t state);

void board_byte(board_t *b, uint8_t byte);
void board_tick(board_t *b);
/* Tell the next telemetry of LATE_TICK or BYTES_LOST. */
void board_notice(board_t *b, uint16_t what);
/* Put the next frame to send into `frame` (LONGEST_FRAME bytes); returns its length, 0 for none. */
uint8_t board_frame(board_t *b, uint8_t *frame);
/* How many bytes a ring of `size` (a power of 2 up to 128) takes, written at `in`, read at `out`;
 * one place stays empty. */
uint8_t ring_room(uint8_t in, uint8_t out, uint8_t size);

/* --- what a kind of board supplies --- */

/* Take a configuration of the right version; returns whether it is this board's and within its
 * bounds. */
uint8_t kind_config(board_t *b, const uint8_t *payload);
/* Take the wish of a fresh command; returns whether it is one for this board. */
uint8_t kind_command(board_t *b, const uint8_t *payload);
/* Whether what it drives is in flight, and would pass its limit: no host configures it meanwhile. */
uint8_t kind_flies(const board_t *b);
/* A millisecond has passed: what is put out now, by the session's state. */
void kind_tick(board_t *b);
/* The end of an answer: the last homing, features. (Of one length in every version: a program of
 * another one reads which it is.) */
uint8_t *kind_answer(const board_t *b, uint8_t *p);
/* A telemetry packet's kind, and its fields after the session's; flags: what it adds to them. */
uint8_t kind_telemetry(const board_t *b, uint16_t *flags);
uint8_t *kind_outputs(const board_t *b, uint8_t *p);

#endif
