/* Feeds standard input to the firmware's parser and state machine, under the sanitizers.
 *
 * Prints every payload that the parser finds, in hex, then the count of bad frames. Between the
 * bytes it configures, arms and commands a board as a host would, moves its counters anyhow, and
 * stops with an error where volts break a promise.
 */
#include "volts.h"

#include "fuzz.h"

static void meddle(board_t *b) {
    uint8_t p[LONGEST_PAYLOAD], i;
    uint16_t next = (uint16_t)(b->session.sequence + 1);
    for (i = 0; i < sizeof p; i++) p[i] = byte();
    switch (byte() % 8) {
    case 0: /* any wiring */
        p[0] = CONFIG_REQUEST, p[1] = byte() % 8 ? PROTOCOL_VERSION : p[1];
        send(b, p, 24);
        break;
    case 1: case 2:
        send_arm(b, p);
        break;
    case 3:
        if (byte() % 16 == 0) send_disarm(b, p);
        break;
    default: /* any volts */
        p[0] = COMMAND, p[1] = (uint8_t)next, p[2] = (uint8_t)(next >> 8);
        send(b, p, 8);
    }
}

static void check(const board_t *b) {
    int i;
    int32_t most = b->catch_ms ? b->limit_mV : b->session.state == IS_LEVELLING ? 3000 : 0;
    if (!(b->wired & WIRED_HOMED) && b->session.state != IS_ARMED) most = 0; /* level is unknown */
    if (!(b->wired & WIRED_HOMED) && most > 1500) most = 1500;
    if (most > LIMIT_MV) most = LIMIT_MV;
    for (i = 0; i < 2; i++)
        if (b->applied_mV[i] > most || b->applied_mV[i] < -most) {
            fprintf(stderr, "%d mV in state %d, at most %d\n", b->applied_mV[i], b->session.state, most);
            exit(3);
        }
    if (b->session.age_ms > WATCHDOG_MS && b->session.commanded && b->session.state == IS_ARMED) {
        fprintf(stderr, "armed without a fresh command for %d ms\n", b->session.age_ms);
        exit(4);
    }
}

int main(void) {
    static board_t b;
    parser_t parser = {{0}, 0, 0};
    uint8_t payload[LONGEST_FRAME], frame[LONGEST_FRAME], length, i;
    int c, n = 0;
    board_init(&b, 1);
    while ((c = getchar()) != EOF) {
        length = parser_byte(&parser, (uint8_t)c, payload);
        for (i = 0; i < length; i++) printf("%02x", payload[i]);
        if (length) printf("\n");
        board_byte(&b, (uint8_t)c);
        if (++n % 16 == 0) {
            if (byte() % 2) meddle(&b);
            b.counts[0] += (int32_t)(draw() >> 28) - 8;
            b.counts[1] = byte() % 64 ? b.counts[1] : (int32_t)draw();
            board_tick(&b);
            check(&b);
            while (board_frame(&b, frame)) {}
        }
    }
    printf("bad %d\n", parser.bad_frames);
    return 0;
}
