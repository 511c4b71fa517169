/* The table's equations once more, by hand and in C: what the compiled simulator is measured
 * against, and checked against. Shares nothing with rig/ but the symbols of the paper.
 *
 * One axis: motor -gear- arm -joint- plate, angles at the servo's shaft; then the ball on the
 * moving plate. Symplectic Euler, dry friction implicitly, play by its exact solution. */
#include <math.h>

#define G 9.81

typedef struct {
    double torque_per_volt, damping, motor_inertia, gear_k, gear_c, gear_decay, gear_1, gear_2;
    double joint_k, joint_c, joint_decay, joint_1, joint_2;
    double limit, sag, dead_up, dead_down, asymmetry, drift, offset;
    double cog, cog_phase, cog_n, coulomb, stribeck, stribeck_speed;
    double ripple, ripple_phase, ripple_n, quadratic, cubic, cross, level, level_drift;
} Axis;

typedef struct {
    Axis axis[2];
    double h, arm_inertia, plate_inertia, arm_friction, joint_friction, stop, ratio, radius, mass;
    double factor, half_side, bowl, resistance, drag;
} Table;

typedef struct {
    double motor, motor_rate, arm, arm_rate, plate, plate_rate, gear_lost, joint_lost;
} Drive;

typedef struct {
    Drive drive[2];
    double x, y, w_x, w_y, spin;
} State;

static inline double largest(double a, double b) { return a > b ? a : b; }
static inline double smallest(double a, double b) { return a < b ? a : b; }

static inline double stick(double speed, double change) {
    return largest(speed - change, 0) + smallest(speed + change, 0);
}

static inline double shaft(double twist, double rate, double lost, double b1, double b2, double k,
                           double c) {
    double torque = k * (twist - lost) + c * rate, out = 0;
    if (lost >= b1) out += largest(torque, 0);
    if (lost <= b2) out += smallest(torque, 0);
    return out;
}

static inline double play(double before, double after, double lost, double b1, double b2,
                          double decay) {
    return smallest(largest(after - (before - lost) * decay, b2), b1);
}

static inline double motor_volts(const Axis *a, double own, double x, double y, double t,
                                 double theta) {
    double v = smallest(largest(own, -a->limit), a->limit);
    v *= 1 - a->sag * (fabs(x) + fabs(y));
    v = largest(v - a->dead_up, 0) + smallest(v + a->dead_down, 0);
    v *= v > 0 ? 1 + a->asymmetry : 1 - a->asymmetry;
    v = v * (1 - a->drift * t) + a->offset;
    if (a->cog != 0) v += a->cog * sin(a->cog_n * theta + a->cog_phase);
    return v;
}

static inline void drive_step(const Table *p, const Axis *a, Drive *s, double volts, double load) {
    double gear = s->motor - s->arm, joint = s->arm - s->plate, dry = a->coulomb;
    double t_gear = shaft(gear, s->motor_rate - s->arm_rate, s->gear_lost, a->gear_1, a->gear_2,
                          a->gear_k, a->gear_c);
    double t_joint = shaft(joint, s->arm_rate - s->plate_rate, s->joint_lost, a->joint_1,
                           a->joint_2, a->joint_k, a->joint_c);
    if (a->stribeck != 0) {
        double u = s->motor_rate / a->stribeck_speed;
        dry += a->stribeck * exp(-u * u);
    }
    double torque = a->torque_per_volt * volts - a->damping * s->motor_rate - t_gear;
    s->motor_rate = stick(s->motor_rate + p->h * torque / a->motor_inertia,
                          p->h * a->torque_per_volt * dry / a->motor_inertia);
    s->arm_rate = stick(s->arm_rate + p->h * (t_gear - t_joint) / p->arm_inertia,
                        p->h * p->arm_friction / p->arm_inertia);
    s->plate_rate = stick(s->plate_rate + p->h * (t_joint + load) / p->plate_inertia,
                          p->h * p->joint_friction / p->plate_inertia);
    s->motor += p->h * s->motor_rate;
    s->arm += p->h * s->arm_rate;
    s->plate += p->h * s->plate_rate;
    if (fabs(s->motor) > p->stop) {
        s->motor = s->motor > 0 ? p->stop : -p->stop;
        s->motor_rate = 0;
    }
    s->gear_lost = play(gear, s->motor - s->arm, s->gear_lost, a->gear_1, a->gear_2, a->gear_decay);
    s->joint_lost =
        play(joint, s->arm - s->plate, s->joint_lost, a->joint_1, a->joint_2, a->joint_decay);
}

/* The angle that the plate feels, and its rate. */
static inline double felt(const Axis *a, double theta, double *rate) {
    double angle = theta + a->quadratic * theta * theta + a->cubic * theta * theta * theta;
    double slope = 1 + 2 * a->quadratic * theta + 3 * a->cubic * theta * theta;
    if (a->ripple != 0) {
        angle += a->ripple * (sin(a->ripple_n * theta + a->ripple_phase) - sin(a->ripple_phase));
        slope += a->ripple * a->ripple_n * cos(a->ripple_n * theta + a->ripple_phase);
    }
    *rate *= slope;
    return angle;
}

static inline void ball_step(const Table *p, State *s, double t) {
    const Axis *ax = &p->axis[0], *ay = &p->axis[1];
    double r = p->radius, h = p->h, k = p->factor;
    double rate_x = s->drive[0].plate_rate, rate_y = s->drive[1].plate_rate;
    double fx = felt(ax, s->drive[0].plate, &rate_x), fy = felt(ay, s->drive[1].plate, &rate_y);
    double a = sin(fx), b = sin(fy), da = cos(fx) * rate_x, db = cos(fy) * rate_y;
    double s_x = p->ratio * (a + ax->cross * b), s_y = p->ratio * (b + ay->cross * a);
    double c = sqrt(1 - s_x * s_x - s_y * s_y);
    double o1 = -p->ratio * (db + ay->cross * da) / c, o2 = p->ratio * (da + ax->cross * db) / c;
    double v_x = s->w_x - r * o2, v_y = s->w_y + r * o1;
    double g_x = G * (s_x + ax->level + ax->level_drift * t);
    double g_y = G * (s_y + ay->level + ay->level_drift * t);
    double gyro = (1 - k) * r * s->spin;
    double a_x = k * (g_x + o2 * o2 * s->x - o1 * o2 * s->y) + gyro * o1;
    double a_y = k * (g_y + o1 * o1 * s->y - o1 * o2 * s->x) + gyro * o2;
    double turn = -(o1 * v_x + o2 * v_y) / r;
    v_x += h * (a_x - p->bowl * s->x - p->drag * v_x);
    v_y += h * (a_y - p->bowl * s->y - p->drag * v_y);
    if (p->resistance > 0) {
        double speed = sqrt(v_x * v_x + v_y * v_y), lost = h * p->resistance;
        double kept = speed <= lost ? 0 : 1 - lost / speed;
        v_x *= kept;
        v_y *= kept;
    }
    s->x += h * v_x;
    s->y += h * v_y;
    s->w_x = v_x + r * o2;
    s->w_y = v_y - r * o1;
    s->spin += h * turn;
}

/* `ticks` control ticks of `steps` steps under volts[ticks][2]; returns the ticks done before the
 * ball fell. */
int run(const Table *table, State *state, const double *volts, int ticks, int steps) {
    Table p = *table;
    State s = *state;
    double weight = p.mass * G * p.ratio;
    int k = 0;
    for (; k < ticks; k++) {
        double x = volts[2 * k], y = volts[2 * k + 1];
        for (int i = 0; i < steps; i++) {
            double t = (k * steps + i) * p.h, load_x = weight * s.x, load_y = weight * s.y;
            drive_step(&p, &p.axis[0], &s.drive[0],
                       motor_volts(&p.axis[0], x, x, y, t, s.drive[0].arm), load_x);
            drive_step(&p, &p.axis[1], &s.drive[1],
                       motor_volts(&p.axis[1], y, x, y, t, s.drive[1].arm), load_y);
            ball_step(&p, &s, t);
            if (fabs(s.x) > p.half_side || fabs(s.y) > p.half_side) goto out;
        }
    }
out:
    *state = s;
    return k;
}

/* Multiply-adds on `n` rounds of 16 vectors of 8 numbers, as many as a core can have under way:
 * returns something that depends on all. 2 * 128 * n flops. */
typedef double Vector __attribute__((vector_size(64)));

double multiply_adds(long n, double by) {
    Vector v[16], m, d, sum;
    for (int i = 0; i < 8; i++) m[i] = by, d[i] = 1e-9, sum[i] = 0;
    for (int j = 0; j < 16; j++) v[j] = d * j;
    for (long k = 0; k < n; k++)
        for (int j = 0; j < 16; j++) v[j] = v[j] * m + d;
    for (int j = 0; j < 16; j++) sum += v[j];
    return sum[0] + sum[7];
}
