/* What the board does, free of the chip: frames in and out, when volts may flow, how it stops.
 *
 * Twin of rig/hardware/board/wire.py (byte for byte). The chip's part (board.c) feeds received bytes to
 * board_byte(), calls board_tick() once a millisecond, puts out `applied_mV` and sends the frames
 * that board_frame() gives. The same file is built for the host to be fuzzed.
 */
#ifndef PROTOCOL_H
#define PROTOCOL_H

#include <stdint.h>

#define PROTOCOL_VERSION 2
#define LONGEST_FRAME 64 /* the closing zero included */
#define LONGEST_PAYLOAD (LONGEST_FRAME - 4)

enum {
    CONFIG_REQUEST = 0x01,
    ARM = 0x02,
    DISARM = 0x03,
    COMMAND = 0x04,
    CONFIG_ANSWER = 0x11,
    TELEMETRY = 0x12,
    TELEMETRY_WITH_TACHOMETER = 0x13
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

enum { HAS_TACHOMETER = 1, IS_FRESH = 2 };
enum { WIRED_HOMED = 1, WIRED_NEGATIVE_0 = 2, WIRED_NEGATIVE_1 = 4, WIRED_CROSSED = 8 };

/* The board's own bounds; the host may ask for less, never for more. */
#ifndef LIMIT_MV
#define LIMIT_MV 6000 /* nominal voltage of the motors */
#endif
#ifndef ANGLE_LIMIT_MRAD
#define ANGLE_LIMIT_MRAD 600 /* from level; the stops of the reference table are at 610 */
#endif
#define HOMING_LIMIT_MV 1500 /* while the zeros are unknown: what a stop can take */
#define LEVEL_LIMIT_MV 3000
#ifndef WATCHDOG_MS
#define WATCHDOG_MS 100
#endif
#ifndef LEVEL_MS
#define LEVEL_MS 500
#endif
#define UNUSED_MS 5000 /* armed, and no command ever came */
#define STALL_MV 2000
#define STALL_MS 300
#define STALL_COUNTS 3
#define FEWEST_COUNTS 64 /* of an encoder in a revolution */
#define RATE_MS 8 /* span over which levelling measures speed */
#define FILTER_MS 16 /* time constant of the speed by which arms are braked */

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

typedef enum { IS_DISARMED, IS_ARMED, IS_LEVELLING, IS_LATCHED } state_t;

typedef struct {
    /* what the chip's part sets before board_tick */
    uint32_t clock_us;
    int32_t counts[2];
    int16_t tachometer_mV[2];
    uint16_t noticed; /* LATE_TICK, BYTES_LOST: told in the next telemetry, then cleared */
    /* constant after board_init */
    uint16_t supply_mV;
    uint8_t has_tachometer;
    /* what the chip's part puts out after board_tick, by motor channel */
    int16_t applied_mV[2];

    parser_t parser;
    state_t state;
    uint16_t reason; /* BY_... of the last stop */
    /* configuration */
    uint8_t fresh; /* reset, and not homed since: the counts mean nothing */
    uint8_t configured, wired, period_ms;
    int32_t zero[2];
    uint16_t angle_limit, limit_mV;
    uint16_t gain; /* of the level loop, 1/16 mV a count */
    uint16_t time_constant_ms; /* of the servo */
    uint16_t delay_half_ms; /* age of the speed when volts act */
    int32_t top_speed; /* at limit_mV, in counts/256 a ms */
    int32_t taper; /* room in which volts are bounded: 0.04 rad, in counts */
    uint32_t token;
    uint16_t nonce;
    /* commands */
    uint8_t commanded; /* since arming */
    uint16_t sequence;
    int16_t wish_mV[2];
    uint8_t ttl_ms;
    uint16_t age_ms; /* of the last fresh command (or of arming) */
    uint16_t level_ms;
    uint8_t limited, expired;
    /* by encoder channel */
    int32_t speed_sum[2]; /* FILTER_MS times the filtered speed in counts/256 a ms */
    int32_t past[2][RATE_MS];
    uint8_t past_at;
    int32_t stall_from[2];
    uint16_t stall_ms[2];
    int8_t stall_sign[2];
    /* output */
    uint8_t answer_due, telemetry_due, since_telemetry_ms;
} board_t;

void board_init(board_t *b, uint16_t supply_mV, uint8_t has_tachometer);
void board_byte(board_t *b, uint8_t byte);
void board_tick(board_t *b);
/* How many bytes a ring of `size` (a power of 2 up to 128) takes, written at `in`, read at `out`;
 * one place stays empty. */
uint8_t ring_room(uint8_t in, uint8_t out, uint8_t size);
/* Put the next frame to send into `frame` (LONGEST_FRAME bytes); returns its length, 0 for none. */
uint8_t board_frame(board_t *b, uint8_t *frame);

#endif
