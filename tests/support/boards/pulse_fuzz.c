/* Feeds standard input to the servo firmware's state machine, under the sanitizers.
 *
 * Between the bytes it configures, arms and commands a board as a host would, with any numbers, and
 * stops with an error where a pulse breaks a promise. Prints how often it was armed, and how many
 * pulses were put out.
 */
#include "pulses.h"

#include "fuzz.h"

/* A servo as one is made, in one of three any number instead of one of the good ones. */
static void servo(uint8_t *p) {
    uint16_t good[6] = {3000, (uint16_t)(byte() * 50 - 6400), 1400, 4600, 2000, 3000};
    if (byte() % 3 == 0) good[byte() % 6] = (uint16_t)(draw() >> 16);
    for (int i = 0; i < 6; i++) p = put16(p, good[i]);
}

static void meddle(board_t *b) {
    uint8_t p[LONGEST_PAYLOAD], i;
    uint16_t next = (uint16_t)(b->session.sequence + 1);
    for (i = 0; i < sizeof p; i++) p[i] = byte();
    switch (byte() % 8) {
    case 0:
        p[0] = PULSE_CONFIG_REQUEST, p[1] = byte() % 8 ? PROTOCOL_VERSION : p[1], p[5] %= 5;
        if (byte() % 8) put16(p + 6, (uint16_t)(4000 + draw() % 16001));
        for (i = 0; i < 3; i++) servo(p + 8 + 12 * i);
        send(b, p, 44);
        break;
    case 1: case 2:
        send_arm(b, p);
        break;
    case 3:
        if (byte() % 16 == 0) send_disarm(b, p);
        break;
    default: /* any angles */
        p[0] = PULSE_COMMAND;
        put16(p + 1, next);
        send(b, p, 9);
    }
}

static void fail(const char *what, int i, long number) {
    fprintf(stderr, "servo %d: %s, %ld\n", i, what, number);
    exit(3);
}

static void check(const board_t *b, const uint16_t *before) {
    int i, is_on = b->session.state == IS_ARMED || b->session.state == IS_LEVELLING;
    if (b->frame_us < SHORTEST_FRAME_US || b->frame_us > LONGEST_FRAME_US) fail("frame", 0, b->frame_us);
    for (i = 0; i < MOST_SERVOS; i++) {
        uint16_t pulse = b->pulse[i];
        const servo_t *one = &b->servo[i];
        long most = (long)abs(one->slope) * one->rate / 5000000 + 1; /* a ms at the rate, rounded */
        if (pulse == 0 && is_on && i < b->servos) fail("no pulse", i, b->session.state);
        if (pulse == 0) continue;
        if (!is_on || i >= b->servos) fail("pulse in state", i, b->session.state);
        if (pulse < SHORTEST_PULSE || pulse > LONGEST_PULSE) fail("pulse", i, pulse);
        if (pulse < one->lowest || pulse > one->highest) fail("out of the servo's range", i, pulse);
        if (labs((long)b->at_urad[i]) > one->limit_urad) fail("angle", i, b->at_urad[i]);
        if (before[i] && abs(pulse - before[i]) > most) fail("jump", i, pulse - before[i]);
    }
    if (b->session.age_ms > WATCHDOG_MS && b->session.commanded && b->session.state == IS_ARMED)
        fail("armed without a fresh command", 0, b->session.age_ms);
}

int main(void) {
    static board_t b;
    uint8_t frame[LONGEST_FRAME];
    uint16_t before[MOST_SERVOS] = {0};
    uint32_t token = 0;
    long armed = 0, pulses = 0;
    int c, i, n = 0;
    board_init(&b, MOST_SERVOS);
    while ((c = getchar()) != EOF) {
        board_byte(&b, (uint8_t)c);
        if (++n % 16) continue;
        if (byte() % 2) meddle(&b);
        if (b.session.token != token) /* configured or armed anew: it begins at level */
            for (i = 0; i < MOST_SERVOS; i++) before[i] = 0;
        token = b.session.token;
        board_tick(&b);
        check(&b, before);
        armed += b.session.state == IS_ARMED;
        for (i = 0; i < MOST_SERVOS; i++) pulses += (before[i] = b.pulse[i]) != 0;
        while (board_frame(&b, frame)) {}
    }
    printf("armed %ld pulses %ld\n", armed, pulses);
    return 0;
}
