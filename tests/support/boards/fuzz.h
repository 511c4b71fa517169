/* What a fuzzer of either board needs, after the board's own header: numbers from a seed, and a
 * host's words.
 */
#include <stdio.h>
#include <stdlib.h>

static uint32_t seed = 1;
static uint32_t draw(void) { return seed = seed * 1664525u + 1013904223u; }
static uint8_t byte(void) { return (uint8_t)(draw() >> 24); }

static void send(board_t *b, uint8_t *payload, uint8_t length) {
    uint8_t frame[LONGEST_FRAME], i, n = frame_encode(payload, length, frame);
    board_byte(b, 0);
    for (i = 0; i < n; i++) board_byte(b, frame[i]);
}

static void send_arm(board_t *b, uint8_t *p) {
    p[0] = ARM;
    put32(p + 1, b->session.token);
    send(b, p, 7);
}

static void send_disarm(board_t *b, uint8_t *p) {
    p[0] = DISARM;
    send(b, p, 1);
}
