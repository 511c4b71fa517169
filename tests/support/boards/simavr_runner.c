/* The real firmware in libsimavr, a millisecond at a time, for Python's ctypes.
 *
 * Encoder lines move edge by edge in the course of the millisecond; the motors' volts are read off
 * the timer's registers and the port pins, as the H-bridges would see them; of watched pins every
 * edge is kept with its cycle.
 */
#include <simavr/avr_ioport.h>
#include <simavr/avr_timer.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdlib.h>
#include <string.h>

#define OUT_SIZE 65536
#define IN_SIZE 65536
#define MOST_WATCHED 4
#define MOST_EDGES 4096

struct runner;
typedef struct {
    struct runner *runner;
    int channel, level;
} watched_t;

typedef struct runner {
    avr_t *avr;
    avr_irq_t *pins[4], *uart_in;
    double due; /* cycles to have run */
    int counts[2];
    int xoff;
    unsigned char out[OUT_SIZE], in[IN_SIZE];
    unsigned out_n, in_first, in_n, late;
    watched_t watched[MOST_WATCHED];
    unsigned long long edges[MOST_EDGES][3]; /* cycle, channel, level */
    unsigned edges_n;
} runner_t;

static const unsigned char GRAY[4] = {0, 1, 3, 2};

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr, (void)cycles; }
static void no_log(avr_t *avr, const int level, const char *format, va_list list) {
    (void)avr, (void)level, (void)format, (void)list;
}
static void on_out(struct avr_irq_t *irq, uint32_t value, void *param) {
    runner_t *r = param;
    (void)irq;
    if (r->out_n < OUT_SIZE) r->out[r->out_n++] = (unsigned char)value;
}
static void on_xon(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)value;
    ((runner_t *)param)->xoff = 0;
}
static void on_xoff(struct avr_irq_t *irq, uint32_t value, void *param) {
    (void)irq, (void)value;
    ((runner_t *)param)->xoff = 1;
}

static void on_edge(struct avr_irq_t *irq, uint32_t value, void *param) {
    watched_t *w = param;
    runner_t *r = w->runner;
    (void)irq;
    if ((int)(value & 1) == w->level || r->edges_n == MOST_EDGES) return;
    w->level = value & 1;
    r->edges[r->edges_n][0] = r->avr->cycle;
    r->edges[r->edges_n][1] = (unsigned)w->channel;
    r->edges[r->edges_n++][2] = (unsigned)w->level;
}

/* libsimavr reads the compare registers of an ATmega328P's timer 1 only when the timer is set up;
 * the chip takes them at the timer's next bottom. Setting its clock, as it was, reads them. */
static void on_compare(struct avr_irq_t *irq, uint32_t value, void *param) {
    uint8_t is_virtual = 0;
    (void)irq, (void)value;
    avr_ioctl(((runner_t *)param)->avr, AVR_IOCTL_TIMER_SET_VIRTCLK('1'), &is_virtual);
}

static void lines(runner_t *r) {
    int e;
    for (e = 0; e < 2; e++) {
        unsigned char g = GRAY[(unsigned)r->counts[e] & 3];
        avr_raise_irq(r->pins[2 * e], g & 1);
        avr_raise_irq(r->pins[2 * e + 1], g >> 1);
    }
}

runner_t *runner_new(const char *elf, const char *mcu) {
    elf_firmware_t firmware;
    uint32_t flags = 0;
    int i;
    runner_t *r = calloc(1, sizeof *r);
    memset(&firmware, 0, sizeof firmware);
    avr_global_logger_set(no_log);
    if (!r || elf_read_firmware(elf, &firmware)) return NULL;
    r->avr = avr_make_mcu_by_name(mcu);
    if (!r->avr) return NULL;
    avr_init(r->avr);
    r->avr->frequency = 16000000;
    avr_load_firmware(r->avr, &firmware);
    r->avr->sleep = no_sleep;
    for (i = 0; i < 4; i++)
        r->pins[i] = avr_io_getirq(r->avr, AVR_IOCTL_IOPORT_GETIRQ('C'), i);
    r->uart_in = avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
    avr_irq_register_notify(
        avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_out, r);
    avr_irq_register_notify(
        avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XON), on_xon, r);
    avr_irq_register_notify(
        avr_io_getirq(r->avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUT_XOFF), on_xoff, r);
    avr_ioctl(r->avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags); /* no printing, no sleeping */
    for (i = TIMER_IRQ_OUT_PWM0; i <= TIMER_IRQ_OUT_PWM1; i++)
        avr_irq_register_notify(
            avr_io_getirq(r->avr, AVR_IOCTL_TIMER_GETIRQ('1'), i), on_compare, r);
    lines(r);
    return r;
}

void runner_free(runner_t *r) {
    avr_terminate(r->avr);
    free(r->avr);
    free(r);
}

void runner_reset(runner_t *r) {
    avr_reset(r->avr);
    r->in_n = r->in_first = 0;
    r->xoff = 0;
    lines(r);
}

/* Bytes for the chip's receiver; what does not fit is lost. */
void runner_receive(runner_t *r, const unsigned char *data, unsigned n) {
    while (n-- && r->in_n < IN_SIZE) r->in[(r->in_first + r->in_n++) % IN_SIZE] = *data++;
}

/* What the chip has sent; returns how much. */
unsigned runner_take(runner_t *r, unsigned char *data) {
    unsigned n = r->out_n;
    memcpy(data, r->out, n);
    r->out_n = 0;
    return n;
}

/* Run `cycles` while the encoders go to these counts; returns the chip's state (below 6: fine). */
int runner_run(runner_t *r, double cycles, int count_0, int count_1) {
    int from[2] = {r->counts[0], r->counts[1]}, go[2] = {count_0 - from[0], count_1 - from[1]};
    int slices = 10, i, e;
    double begin = r->due;
    for (e = 0; e < 2; e++)
        if (abs(go[e]) > slices) slices = abs(go[e]);
    r->due += cycles;
    for (i = 1; i <= slices; i++) {
        avr_cycle_count_t until = (avr_cycle_count_t)(begin + cycles * i / slices);
        for (e = 0; e < 2; e++) r->counts[e] = from[e] + go[e] * i / slices;
        lines(r);
        while (r->in_n && !r->xoff) {
            unsigned char byte = r->in[r->in_first];
            r->in_first = (r->in_first + 1) % IN_SIZE;
            r->in_n--;
            avr_raise_irq(r->uart_in, byte);
        }
        while (r->avr->cycle < until)
            if (avr_run(r->avr) >= cpu_Done) return r->avr->state;
    }
    return r->avr->state;
}

/* Keep the edges of a port's pin from now on, as this channel's. */
void runner_watch(runner_t *r, char port, int pin, int channel) {
    r->watched[channel].runner = r;
    r->watched[channel].channel = channel;
    avr_irq_register_notify(
        avr_io_getirq(r->avr, AVR_IOCTL_IOPORT_GETIRQ(port), pin), on_edge, &r->watched[channel]);
}

/* The edges since the last call, by threes; returns how many. */
unsigned runner_edges(runner_t *r, unsigned long long *edges) {
    unsigned n = r->edges_n;
    memcpy(edges, r->edges, n * sizeof r->edges[0]);
    r->edges_n = 0;
    return n;
}

/* Duty of a motor's H-bridge, -1 to 1, off the registers of an ATmega328P. */
double runner_duty(runner_t *r, int motor) {
    const uint8_t *d = r->avr->data;
    unsigned compare = motor ? d[0x8A] | d[0x8B] << 8 : d[0x88] | d[0x89] << 8;
    unsigned top = d[0x86] | d[0x87] << 8, connected = d[0x80] & (motor ? 0x20 : 0x80);
    unsigned is_output = d[0x24] & (motor ? 4 : 2), clocked = d[0x81] & 7;
    unsigned is_reverse = d[0x2B] & (motor ? 0x80 : 0x10);
    double duty = d[0x25] & (motor ? 4 : 2) ? 1.0 : 0.0; /* the port's own level */
    if (!is_output) return 0.0;
    if (connected && clocked && top) duty = (compare + 1.0) / (top + 1.0);
    return is_reverse ? -duty : duty;
}

unsigned long long runner_cycles(const runner_t *r) { return r->avr->cycle; }
