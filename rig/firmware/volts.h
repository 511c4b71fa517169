/* A board with two H-bridges and two quadrature encoders: when volts may flow, and how many. */
#ifndef VOLTS_H
#define VOLTS_H

#include "protocol.h"

enum { WIRED_HOMED = 1, WIRED_NEGATIVE_0 = 2, WIRED_NEGATIVE_1 = 4, WIRED_CROSSED = 8 };

/* The board's own bounds; the host may ask for less, never for more. */
#ifndef LIMIT_MV
#define LIMIT_MV 6000 /* nominal voltage of the motors */
#endif
#if LIMIT_MV > 16000
#error "LIMIT_MV: 16000 at most, or the volts that a servo's speed follows overflow 32 bits"
#endif
#define LAG_HALVINGS 5
#define LAG_PARTS (1 << LAG_HALVINGS) /* of a mV: 2 LIMIT_MV in them times any lag_share < 2^31 */
#ifndef ANGLE_LIMIT_MRAD
#define ANGLE_LIMIT_MRAD 600 /* from level; the stops of the reference table are at 610 */
#endif
#define HOMING_LIMIT_MV 1500 /* while the zeros are unknown: what a stop can take */
#define LEVEL_LIMIT_MV 3000
#define STALL_MV 2000
#define STALL_MS 300
#define FEWEST_COUNTS 64 /* of an encoder in a revolution */
#define RATE_MS 8 /* span over which levelling measures speed */
#define MOST_COUNTS 100 /* of an arm in a ms: more is no motion */
#define FILTER_HALVINGS 4
#define FILTER_MS (1 << FILTER_HALVINGS) /* time constant of the speed by which arms are braked */
#define MOVED_COUNTS 2 /* more is a motion, at least: an arm at the edge of a count shows one */
#define CATCH_TAUS 5 /* so long after the session arms are still braked; e^-5 is left at 0 V */

struct board {
    session_t session;
    /* what the chip's part sets before board_tick */
    int32_t counts[2];
    int16_t tachometer_mV[2];
    uint8_t has_tachometer; /* constant after board_init */
    /* what the chip's part puts out after board_tick, by motor channel */
    int16_t applied_mV[2];

    /* configuration */
    uint32_t homing; /* token that last armed it with unknown zeros; 0: none since the reset */
    uint8_t wired;
    int32_t zero[2];
    uint16_t angle_limit, limit_mV;
    uint16_t gain; /* of the level loop, 1/16 mV a count */
    uint16_t time_constant_ms; /* of the servo */
    uint16_t delay_half_ms; /* age of the speed when volts act */
    int32_t top_speed; /* at limit_mV, in counts/256 a ms */
    int32_t free_gain; /* of a motor that runs free: counts/256 a ms for 256 of lagged, 1/256 */
    int32_t taper; /* room in which volts are bounded: 0.04 rad, in counts */
    uint16_t sure_mV[2][2]; /* that surely move the arm of an encoder channel, STALL_MV at most */
    int32_t push_limit; /* of volts beyond these without motion, in mV times 2 ms */
    int32_t moved; /* a motion, in counts */
    int16_t lag_share; /* of the way to the volts that lagged goes in 2 ms, 1/4096 */
    /* commands */
    int16_t wish_mV[2];
    uint8_t ttl_ms;
    uint8_t limited, expired;
    uint32_t catch_ms; /* how long arms in flight are still braked */
    /* by encoder channel */
    int32_t speed_sum[2]; /* FILTER_MS times the filtered speed in counts/256 a ms */
    int32_t past[2][RATE_MS];
    uint8_t past_at;
    int32_t stall_from[2];
    uint16_t stall_ms[2];
    int8_t stall_sign[2];
    int32_t still_from[2], lagged[2]; /* volts as speed follows them, mV/LAG_PARTS */
    int32_t push[2][2]; /* up and down */
    uint8_t lost; /* bit 0, 1: of what showed a stall: it gets no volts until configured anew */
};

void board_init(board_t *b, uint8_t has_tachometer);

#endif
