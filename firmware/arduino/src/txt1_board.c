/*
 * The board in portable C: see txt1_board.h. Each function is the one of the same name in firmware/pico/txt1pico; a
 * change belongs into both, and tests/unit/firmware/test_c_board.py compares them.
 */
#include "txt1_board.h"

#define DATA 4
#define SPACER 0x00
#define INT_MAX_WIRE ((1L << 29) - 1)
#define AGE_MAX (1L << 20)
#define STANDS 300
#define KP_MAX (1L << 18)
#define KI_MAX (1L << 20)
#define KD_MAX (1L << 17)
#define TURN (1L << 28)
/* counts of an encoder between two cycles; a car at its fastest makes 100 in 20 ms */
#define COUNTS_MAX 2000
#define IDENTITY_MAX 63

enum { NOTHING, FAST, APART, AGAINST, BOTH_SILENT, RIGHT_SILENT, LEFT_SILENT };

/* -- whole numbers ---------------------------------------------------------------------------------------------- */

/* Return a / b rounded down, b > 0. */
static int32_t floored(int32_t a, int32_t b)
{
    int32_t quotient = a / b;
    return a % b < 0 ? quotient - 1 : quotient;
}

static int32_t floored64(int64_t a, int64_t b)
{
    int64_t quotient = a / b;
    return (int32_t)(a % b < 0 ? quotient - 1 : quotient);
}

/* Return a - b floored(a, b), 0 to b - 1. */
static int32_t modulo(int32_t a, int32_t b)
{
    int32_t rest = a % b;
    return rest < 0 ? rest + b : rest;
}

/* Return a / 2^bits rounded down. */
static int32_t shifted(int32_t a, int bits)
{
    return floored(a, (int32_t)1 << bits);
}

static int32_t clip(int32_t value, int32_t limit)
{
    return value > limit ? limit : value < -limit ? -limit : value;
}

static int32_t magnitude(int32_t value)
{
    return value < 0 ? -value : value;
}

static int32_t smaller(int32_t a, int32_t b)
{
    return a < b ? a : b;
}

static int32_t larger(int32_t a, int32_t b)
{
    return a > b ? a : b;
}

/* Return a b / c, cut, without an overflow. */
static int32_t scaled(int32_t a, int32_t b, int32_t c)
{
    return (int32_t)((int64_t)a * b / c);
}

/* Set bytes to 0. */
static void clear(void *memory, size_t size)
{
    uint8_t *bytes = (uint8_t *)memory;
    while (size--)
        *bytes++ = 0;
}

/* -- frames ----------------------------------------------------------------------------------------------------- */

static const uint8_t HOST_FRAMES[] = TXT1_HOST_FRAMES;

static bool legal(int32_t length, int32_t command)
{
    size_t at;
    if (command == TXT1_PID_SET)
        return length >= 12 && length <= 12 + 16 * TXT1_SETS_MAX && (length - 12) % 16 == 0;
    for (at = 0; at < sizeof HOST_FRAMES; at += 2)
        if (HOST_FRAMES[at] == command && HOST_FRAMES[at + 1] == length)
            return true;
    return false;
}

static uint16_t checksum(const uint8_t *buffer, int32_t start, int32_t end)
{
    uint32_t total = 0;
    while (end - start > 1) {
        total += (uint32_t)buffer[start] << 8 | buffer[start + 1];
        start += 2;
    }
    if (start < end)
        total ^= buffer[start];
    return (uint16_t)(total & 0xFFFF);
}

static int32_t int16_at(const uint8_t *data)
{
    int32_t value = (int32_t)data[0] << 8 | data[1];
    return value & 0x8000 ? value - 65536 : value;
}

static int32_t int32_at(const uint8_t *data)
{
    int32_t high = int16_at(data);
    if (high >= 1 << 13)
        return INT_MAX_WIRE;
    if (high < -(1 << 13))
        return -INT_MAX_WIRE;
    return high * 65536 + ((int32_t)data[2] << 8 | data[3]);
}

static void put_byte(struct txt1_receiver *r, uint8_t byte)
{
    if (r->end == TXT1_RECEIVED) {
        int32_t shift, at;
        if (r->start == 0) {
            /* the longest frame has half of the buffer's length, so this is noise that nobody took */
            r->start = TXT1_RECEIVED / 2;
            r->lost += TXT1_RECEIVED / 2;
        }
        shift = r->start;
        for (at = shift; at < r->end; at++)
            r->buffer[at - shift] = r->buffer[at];
        r->start = 0;
        r->end -= shift;
        r->settled = larger(r->settled - shift, 0);
    }
    r->buffer[r->end++] = byte;
}

/* Return the place of the next whole frame, or -1 when more bytes have to come. */
static int32_t next_frame(struct txt1_receiver *r)
{
    const uint8_t *buffer = r->buffer;
    int32_t end = r->end;
    while (end - r->start >= 2) {
        int32_t at = r->start, length, command, whole;
        bool inside;
        if (buffer[at] != 0xFA || buffer[at + 1] != 0xFB) {
            r->start = at + 1;
            continue;
        }
        if (end - at < DATA)
            return -1;
        length = buffer[at + 2];
        command = buffer[at + 3];
        /* of an intact frame, where only one that goes beyond it counts */
        inside = at < r->settled;
        if (!legal(length, command)) {
            r->start = at + 1;
            if (!inside) {
                r->foreign++;
                if (command == TXT1_PID_SET && length != 1)
                    r->refused = true;
            }
            continue;
        }
        whole = at + length + 6;
        if (end < whole)
            return -1;
        r->start = at + 1;
        if (checksum(buffer, at + 3, at + DATA + length) != (uint16_t)((uint16_t)(buffer[whole - 2] << 8) | buffer[whole - 1])) {
            r->damaged += !inside;
            continue;
        }
        if (whole > r->settled) {
            r->settled = whole;
            return at;
        }
    }
    if (end > r->start && buffer[r->start] != 0xFA)
        r->start = end;
    if (r->start == r->end)
        r->start = r->end = r->settled = 0;
    return -1;
}

static void expire(struct txt1_receiver *r)
{
    if (r->end > r->start) {
        r->foreign++;
        r->start++;
    }
}

static bool begin_frame(struct txt1_transmitter *t, uint8_t command, int32_t length)
{
    int32_t at = t->length;
    if (at + length + 7 > TXT1_SENT) {
        t->lost++;
        return false;
    }
    if (at)
        t->buffer[at++] = SPACER;
    t->at = at;
    t->buffer[at] = 0xFA;
    t->buffer[at + 1] = 0xFB;
    t->buffer[at + 2] = (uint8_t)length;
    t->buffer[at + 3] = command;
    t->length = at + DATA;
    return true;
}

static void write_byte(struct txt1_transmitter *t, int32_t value)
{
    t->buffer[t->length++] = (uint8_t)(value & 0xFF);
}

static void write_int16(struct txt1_transmitter *t, int32_t value)
{
    write_byte(t, (int32_t)((uint32_t)value >> 8));
    write_byte(t, value);
}

static void write_int32(struct txt1_transmitter *t, int32_t value)
{
    write_int16(t, (int32_t)((uint32_t)value >> 16));
    write_int16(t, value);
}

static void finish_frame(struct txt1_transmitter *t)
{
    write_int16(t, checksum(t->buffer, t->at + 3, t->length));
}

/* -- the loops ---------------------------------------------------------------------------------------------------- */

static void pid_clear(struct txt1_pid *p)
{
    p->output = p->counts = p->rest = p->error = p->before = 0;
}

static void pid_begin(struct txt1_pid *p, int32_t scale, int32_t limit)
{
    p->limit = limit;
    p->half = 8 * scale;
    p->whole = 50000 * scale;
    pid_clear(p);
}

/* Take a new error; the output in PWM counts, cut towards 0, is left in `output`. */
static void pid_step(struct txt1_pid *p, int32_t error, int32_t kp, int32_t ki, int32_t kd)
{
    int32_t half = p->half, whole = p->whole, quarter = half / 2;
    int32_t change = error - p->error, bend = change - p->error + p->before;
    int32_t high, low, counts, rest, part;
    /* proportional */
    high = kp * floored(change, half);
    low = kp * modulo(change, half);
    counts = floored(high, 125);
    rest = modulo(high, 125) * half + low;
    counts += floored(rest, 125 * half);
    rest = modulo(rest, 125 * half) * 50;
    /* integral */
    high = ki * floored(error, half);
    low = ki * modulo(error, half);
    counts += floored(high, 6250);
    part = modulo(high, 6250) * half + low;
    counts += floored(part, whole);
    rest += modulo(part, whole);
    /* derivative */
    high = 2 * kd * floored(bend, half);
    low = kd * modulo(bend, half);
    counts += floored(high, 5);
    part = modulo(high, 5) * quarter + low;
    counts += floored(part, 5 * quarter);
    rest += modulo(part, 5 * quarter) * 2500;
    rest += p->rest;
    counts += p->counts + floored(rest, whole);
    rest = modulo(rest, whole);
    if (counts >= p->limit) {
        counts = p->limit;
        rest = 0;
    } else if (counts < -p->limit) {
        counts = -p->limit;
        rest = 0;
    }
    p->counts = counts;
    p->rest = rest;
    p->before = p->error;
    p->error = error;
    p->output = counts < 0 && rest ? counts + 1 : counts;
}

/* -- odometry ------------------------------------------------------------------------------------------------------ */

/* a quarter of the sine, 32767 high, in 64 steps */
static const int16_t SINES[] = {
    0, 804, 1608, 2410, 3212, 4011, 4808, 5602, 6393, 7179, 7962, 8739, 9512, 10278, 11039, 11793, 12539, 13279, 14010,
    14732, 15446, 16151, 16846, 17530, 18204, 18868, 19519, 20159, 20787, 21403, 22005, 22594, 23170, 23731, 24279,
    24811, 25329, 25832, 26319, 26790, 27245, 27683, 28105, 28510, 28898, 29268, 29621, 29956, 30273, 30571, 30852,
    31113, 31356, 31580, 31785, 31971, 32137, 32285, 32412, 32521, 32609, 32678, 32728, 32757, 32767,};

/* Return the sine of an angle in parts of a turn (2^28), 32767 high. */
static int32_t sine(int32_t angle)
{
    bool negative;
    int32_t at, between, value;
    angle = modulo(angle, TURN);
    negative = angle >= TURN / 2;
    if (negative)
        angle -= TURN / 2;
    if (angle > TURN / 4)
        angle = TURN / 2 - angle;
    at = angle >> 20;
    between = angle & 0xFFFFF;
    value = SINES[at];
    if (between)
        value += ((SINES[at + 1] - value) * (between >> 8)) >> 12;
    return negative ? -value : value;
}

static void odometry_begin(struct txt1_odometry *o, int32_t circumference, int32_t track)
{
    double turn = (double)TURN * circumference / 10.0 / TXT1_COUNTS_PER_REV / (2.0 * 3.141592653589793 * track);
    clear(o, sizeof *o);
    o->path = circumference / 5;
    o->circumference = circumference;
    o->turn = circumference * 50;
    o->track = track;
    o->turn_high = (int32_t)turn;
    o->turn_low = (int32_t)((turn - (double)o->turn_high) * (1L << 20));
}

/* Return half counts as mm: 32000 of them are ten circumferences' worth of 0.1 mm. */
static int32_t millimetres(const struct txt1_odometry *o, int32_t halves)
{
    int32_t whole = floored(halves, 32000), rest = modulo(halves, 32000);
    return whole * o->circumference + floored(rest * o->circumference + 16000, 32000);
}

static void advance(struct txt1_odometry *o, int32_t right, int32_t left, int32_t periods)
{
    int32_t path = right + left, turned = right - left, fine, step, mean, rest, heading;
    int64_t more;
    o->v = floored(path * o->path, periods);
    o->omega = floored64((int64_t)turned * o->turn, (int64_t)o->track * periods);
    if (!(path || turned))
        return;
    /* 2^-20 of the parts, then whole parts */
    more = o->more + (int64_t)turned * o->turn_low;
    fine = floored64(more, 1L << 20);
    o->more = (int32_t)(more - (int64_t)fine * (1L << 20));
    step = turned * o->turn_high + fine;
    mean = o->heading + shifted(step, 1);
    o->heading = modulo(o->heading + step, TURN);
    rest = o->x_rest + path * sine(mean + TURN / 4);
    o->half_x += floored(rest, 32767);
    o->x_rest = modulo(rest, 32767);
    rest = o->y_rest + path * sine(mean);
    o->half_y += floored(rest, 32767);
    o->y_rest = modulo(rest, 32767);
    o->x = millimetres(o, o->half_x);
    o->y = millimetres(o, o->half_y);
    /* 2^28 parts are 2 pi: 6283.185 mrad */
    heading = o->heading <= TURN / 2 ? o->heading : o->heading - TURN;
    heading = shifted(heading, 12);
    o->theta = shifted(heading * 6283 + floored(heading * 12, 65) + (1L << 15), 16);
}

/* -- runaway ------------------------------------------------------------------------------------------------------- */

/* Return what the encoders say is wrong, or NOTHING. */
static int watch_check(struct txt1_watch *w, int32_t motor, int32_t right, int32_t left, int32_t v, int32_t combined,
                       int32_t dt)
{
    bool fast = magnitude(v) > TXT1_RUNAWAY_SPEED * 128L, apart = magnitude(combined - v) > TXT1_DISAGREEMENT * 128L;
    bool against, driven, right_long, left_long;
    if (right * left > 0 && !(fast || apart)) {
        clear(w, sizeof *w);
        return NOTHING;
    }
    w->fast = fast ? w->fast + dt : 0;
    if (w->fast >= TXT1_PERSISTS)
        return FAST;
    w->apart = apart ? w->apart + dt : 0;
    if (w->apart >= TXT1_RUNAWAY_TIME)
        return APART;
    against = right * left < 0 && smaller(magnitude(right), magnitude(left)) > TXT1_NOISE_COUNTS;
    w->against = against ? w->against + dt : 0;
    if (w->against >= TXT1_PERSISTS)
        return AGAINST;
    driven = magnitude(motor) > TXT1_RUNAWAY_MOTOR;
    if (right) {
        w->right = w->right_passed = 0;
    } else {
        w->right = driven ? w->right + dt : 0;
        w->right_passed += magnitude(left);
    }
    if (left) {
        w->left = w->left_passed = 0;
    } else {
        w->left = driven ? w->left + dt : 0;
        w->left_passed += magnitude(right);
    }
    right_long = w->right >= TXT1_RUNAWAY_TIME || w->right_passed > TXT1_RUNAWAY_COUNTS;
    left_long = w->left >= TXT1_RUNAWAY_TIME || w->left_passed > TXT1_RUNAWAY_COUNTS;
    if (right_long && left_long)
        return BOTH_SILENT;
    if (right_long)
        return RIGHT_SILENT;
    return left_long ? LEFT_SILENT : NOTHING;
}

/* -- the gate ------------------------------------------------------------------------------------------------------ */

static void neutral(struct txt1_board *b)
{
    b->outputs[0] = b->outputs[1] = b->outputs[2] = 0;
    b->v = b->omega = 0;
}

void txt1_board_disarm(struct txt1_board *b, enum txt1_reason reason)
{
    if (b->armed) {
        b->armed = false;
        b->reason = reason;
    }
    neutral(b);
}

/* Let no command count that came before now. */
static void renew(struct txt1_board *b)
{
    b->epoch_ok = b->manual_ok = false;
}

/* Open the gate with the link, and after any other stop when the host has asked for nothing for a second. */
static void arm(struct txt1_board *b)
{
    if (!b->link_alive || b->wanted_age >= TXT1_LET_GO)
        b->may_arm = true;
    if (b->armed) {
        b->may_arm = false;
    } else if (b->may_arm && !b->released && b->link_alive && b->switches & TXT1_ATX && b->bad_age < TXT1_BAD_TIME) {
        b->armed = true;
        b->reason = TXT1_ARMED;
        renew(b);
        clear(&b->watch, sizeof b->watch);
    }
}

/* -- bytes for the host --------------------------------------------------------------------------------------------- */

static void answer(struct txt1_board *b, bool accepted)
{
    struct txt1_transmitter *t = &b->transmitter;
    if (begin_frame(t, TXT1_PID_SET, 1)) {
        write_byte(t, accepted ? TXT1_ACCEPTED : TXT1_REJECTED);
        finish_frame(t);
    }
}

static void identify(struct txt1_board *b)
{
    struct txt1_transmitter *t = &b->transmitter;
    int32_t length = 0, at;
    while (b->identity[length] && length < IDENTITY_MAX)
        length++;
    if (begin_frame(t, TXT1_IDENTITY, length)) {
        for (at = 0; at < length; at++)
            write_byte(t, (uint8_t)b->identity[at]);
        finish_frame(t);
    }
}

static void send_odometry(struct txt1_board *b)
{
    struct txt1_transmitter *t = &b->transmitter;
    const struct txt1_odometry *o = &b->odometry;
    if (begin_frame(t, TXT1_ENCODER_ODOMETRY, 20)) {
        write_int32(t, o->x);
        write_int32(t, o->y);
        write_int32(t, o->theta);
        write_int32(t, shifted(o->v + 64, 7));
        write_int32(t, shifted(o->omega + 8, 4));
        finish_frame(t);
    }
}

static void send_battery(struct txt1_board *b)
{
    struct txt1_transmitter *t = &b->transmitter;
    if (begin_frame(t, TXT1_BATTERY_LEVELS, 4)) {
        write_int16(t, shifted(b->voltage1, 4));
        write_int16(t, shifted(b->voltage2, 4));
        finish_frame(t);
    }
}

/* -- bytes of the host ---------------------------------------------------------------------------------------------- */

/* Keep a set-point, brought inside the limits: speed first, then yaw rate by (2.16). */
static void take_velocity(struct txt1_board *b, int32_t v, int32_t omega)
{
    if (v || omega)
        b->wanted_age = 0;
    b->asked_v = v = clip(v, TXT1_V_MAX);
    b->asked_omega = clip(16 * omega, scaled(magnitude(v), 16000, TXT1_RADIUS_MIN));
    b->age = 0;
    b->epoch_ok = true;
}

static void take_servos(struct txt1_board *b, const uint8_t *data)
{
    b->servos[0] = clip(int32_at(data), TXT1_PWM_MAX);
    b->servos[1] = clip(int32_at(data + 4), TXT1_PWM_MAX);
}

static bool fits(const uint8_t *data)
{
    return magnitude(int32_at(data)) <= KP_MAX && magnitude(int32_at(data + 4)) <= KI_MAX &&
           magnitude(int32_at(data + 8)) <= KD_MAX;
}

/* Load the gains of a PID set; false, and nothing changed, when they are not acceptable. */
static bool take_gains(struct txt1_board *b, const uint8_t *data, int32_t length)
{
    int32_t count = (length - 12) / 16, before = -INT_MAX_WIRE, k;
    for (k = 0; k < count; k++) {
        int32_t v_max = int32_at(data + 12 + 16 * k);
        if (v_max <= before || !fits(data + 16 + 16 * k))
            return false;
        before = v_max;
    }
    if (!fits(data))
        return false;
    for (k = 0; k < 3; k++)
        b->linear_gains[k] = int32_at(data + 4 * k);
    for (k = 0; k < 4 * count; k++)
        b->sets[k] = int32_at(data + 12 + 4 * k);
    b->set_count = count;
    return true;
}

/* Turn a supply on or off; the ATX supply, which feeds the encoders, only when they saw it stand. */
static void take_switch(struct txt1_board *b, int32_t which, int32_t on)
{
    if (which > 1 || on > 1)
        return;
    if (which == 0 && !on) {
        bool stands = b->still_age >= STANDS || !(b->switches & TXT1_ATX);
        if (b->armed && b->wanted_age >= TXT1_LET_GO && stands)
            txt1_board_disarm(b, TXT1_ATX_OFF);
        if (b->armed || !stands)
            return;
    }
    b->switches = on ? b->switches | 1 << which : b->switches & ~(1 << which);
}

static void take_release(struct txt1_board *b, const uint8_t *data)
{
    size_t k;
    for (k = 0; k < sizeof TXT1_RELEASE - 1; k++)
        if (data[k] != (uint8_t)TXT1_RELEASE[k])
            return;
    if (!b->link_alive && !b->odometry.v) {
        b->released = true;
        txt1_board_disarm(b, TXT1_RELEASED);
    }
}

static void take_frame(struct txt1_board *b, const uint8_t *at)
{
    const uint8_t *data = at + DATA;
    int32_t channel;
    b->received++;
    switch (at[3]) {
    case TXT1_VELOCITY:
        b->velocities++;
        take_velocity(b, int16_at(data), int16_at(data + 2));
        break;
    case TXT1_PID_SET:
        answer(b, take_gains(b, data, at[2]));
        break;
    case TXT1_COMBINED_ODOMETRY:
        b->combined++;
        b->combined_v = clip(int32_at(data + 12), TXT1_MEASURED_MAX) * 128;
        b->combined_omega = clip(int32_at(data + 16), TXT1_MEASURED_MAX) * 16;
        b->combined_age = 0;
        break;
    case TXT1_PWM_TEST:
        if (b->manual) {
            for (channel = 0; channel < 3; channel++)
                b->manual_pwm[channel] = clip(int32_at(data + 4 * channel), TXT1_PWM_MAX);
            take_servos(b, data + 12);
            b->manual_age = 0;
            b->manual_ok = true;
            if (b->manual_pwm[0])
                b->wanted_age = 0;
        }
        break;
    case TXT1_PWM_COMMAND:
        take_servos(b, data);
        break;
    case TXT1_POWER_CONTROL:
        take_switch(b, data[0], data[1]);
        break;
    case TXT1_IDENTITY:
        if (at[2] == 0)
            identify(b);
        else
            take_release(b, data);
        break;
    default:
        break;
    }
}

static void obey(struct txt1_board *b)
{
    int32_t at;
    while ((at = next_frame(&b->receiver)) >= 0)
        take_frame(b, b->receiver.buffer + at);
    if (b->receiver.refused) {
        b->receiver.refused = false;
        answer(b, false);
    }
}

void txt1_board_receive(struct txt1_board *b, const uint8_t *data, size_t count)
{
    size_t at;
    b->byte_age = 0;
    for (at = 0; at < count; at++) {
        put_byte(&b->receiver, data[at]);
        if (b->receiver.end - b->receiver.start >= 6)
            obey(b);
    }
    obey(b);
}

/* -- one cycle ------------------------------------------------------------------------------------------------------ */

static void older(int32_t *age, int32_t dt)
{
    *age = smaller(*age + dt, AGE_MAX);
}

static void grow_older(struct txt1_board *b, int32_t dt)
{
    older(&b->age, dt);
    older(&b->manual_age, dt);
    older(&b->combined_age, dt);
    older(&b->wanted_age, dt);
    older(&b->byte_age, dt);
    older(&b->still_age, dt);
    if (b->byte_age >= TXT1_SILENCE_MS && b->receiver.end > b->receiver.start) {
        expire(&b->receiver);
        obey(b);
    }
}

static void put(struct txt1_board *b, int32_t motor, int32_t front, int32_t rear)
{
    b->outputs[0] = clip(motor, TXT1_MOTOR_MAX);
    b->outputs[1] = clip(front, TXT1_STEERING_MAX);
    b->outputs[2] = clip(rear, TXT1_STEERING_MAX);
}

static void step_loops(struct txt1_board *b, int32_t v_now, int32_t omega_now)
{
    const int32_t *gains = b->linear_gains, *set;
    int32_t last = b->set_count - 1, which = 0, error, steering = 0;
    pid_step(&b->linear, 128 * b->v - v_now, gains[0], gains[1], gains[2]);
    while (which < last && (int64_t)b->sets[4 * which] * 128 < v_now)
        which++;
    error = b->omega - omega_now;
    /* in reverse the steering acts the other way round */
    if (v_now < 0)
        error = -error;
    if (last >= 0) {
        set = b->sets + 4 * which;
        pid_step(&b->angular, error, set[1], set[2], set[3]);
        steering = b->angular.output;
    }
    /* u > 0 turns left: the front wheels to the left, the rear ones to the right */
    put(b, b->linear.output, -steering, steering);
}

/* Both loops, through the gate to the outputs. */
static void control(struct txt1_board *b, int32_t dt)
{
    const struct txt1_odometry *o = &b->odometry;
    bool combined = b->combined_selected && b->combined_age <= TXT1_COMBINED_TIMEOUT, manual = b->manual, fresh, rests;
    int32_t v_now = combined ? b->combined_v : clip(o->v, TXT1_MEASURED_MAX * 128L);
    int32_t omega_now = combined ? b->combined_omega : clip(o->omega, TXT1_MEASURED_MAX * 16L);
    if (b->armed && watch_check(&b->watch, b->outputs[0], b->right, b->left, o->v, combined ? v_now : o->v, dt))
        txt1_board_disarm(b, TXT1_RUNAWAY);
    if (manual)
        fresh = b->manual_ok && b->manual_age <= TXT1_COMMAND_TIMEOUT;
    else
        fresh = b->epoch_ok && b->age <= TXT1_COMMAND_TIMEOUT;
    rests = !manual && v_now == 0 && b->asked_v == 0;
    if (b->armed) {
        b->outputs[3] = b->servos[0];
        b->outputs[4] = b->servos[1];
    }
    if (!(b->armed && fresh && b->link_alive && b->switches & TXT1_ESC) || manual != b->was_manual || rests) {
        pid_clear(&b->linear);
        pid_clear(&b->angular);
        neutral(b);
    } else if (manual) {
        put(b, b->manual_pwm[0], b->manual_pwm[1], b->manual_pwm[2]);
    } else {
        b->v = b->asked_v;
        b->omega = clip(b->asked_omega, scaled(magnitude(b->v), 16000, TXT1_RADIUS_MIN));
        step_loops(b, v_now, omega_now);
    }
    b->was_manual = manual;
}

/* Say whether the host is alive, and which odometry counts, by the messages of the last second. */
static void judge_link(struct txt1_board *b)
{
    bool alive = b->velocities > TXT1_VELOCITY_MIN;
    b->combined_selected = b->combined > TXT1_COMBINED_MIN;
    b->velocities = b->combined = 0;
    if (!alive)
        txt1_board_disarm(b, TXT1_LINK_LOST);
    b->link_alive = alive;
}

/* Smooth the voltages (kept in 1/16 mV), judge them, send them. */
static void judge_batteries(struct txt1_board *b, int32_t one, int32_t two)
{
    int32_t best, reading = larger(one, two);
    if (b->smoothed) {
        b->voltage1 = floored(6 * b->voltage1 + 64 * one, 10);
        b->voltage2 = floored(6 * b->voltage2 + 64 * two, 10);
    } else {
        b->voltage1 = 16 * one;
        b->voltage2 = 16 * two;
        b->smoothed = true;
    }
    best = shifted(larger(b->voltage1, b->voltage2), 4);
    if (best < TXT1_FITTED)
        b->battery_state = TXT1_EXTERNAL;
    else if (best > TXT1_GOOD)
        b->battery_state = TXT1_BATTERY_GOOD;
    else
        b->battery_state = best > TXT1_WARNING ? TXT1_BATTERY_WARNING : TXT1_BATTERY_BAD;
    b->bad_age = b->battery_state == TXT1_BATTERY_BAD ? smaller(b->bad_age + 1000, AGE_MAX) : 0;
    if (TXT1_FITTED <= reading && reading <= TXT1_CUT_OFF) {
        txt1_board_disarm(b, TXT1_CUT_OFF_REACHED);
        b->bad_age = AGE_MAX;
    } else if (b->bad_age > TXT1_BAD_TIME) {
        txt1_board_disarm(b, TXT1_BATTERIES_BAD);
    }
    send_battery(b);
}

/* Act on an edge of the button. */
static void press(struct txt1_board *b, int32_t buttons)
{
    int32_t edges = buttons & ~b->pressed;
    b->pressed = buttons;
    if (edges & TXT1_CENTRE) {
        b->manual = !b->manual;
        renew(b);
    }
}

/* Return whether the buzzer sounds: without a pause while nobody drives, else as low or empty packs have it. */
static bool sounds(const struct txt1_board *b)
{
    if (!b->link_alive)
        return true;
    if (b->battery_state == TXT1_BATTERY_WARNING)
        return b->beeps < TXT1_BEEP_LOW;
    return b->battery_state == TXT1_BATTERY_BAD && b->beeps % (2 * TXT1_BEEP_EMPTY) < TXT1_BEEP_EMPTY;
}

void txt1_board_step(struct txt1_board *b, int32_t right, int32_t left, int32_t voltage1, int32_t voltage2,
                     int32_t buttons, int32_t periods)
{
    int32_t dt;
    if (periods < 1)
        periods = 1;
    if (periods > 1000)
        periods = 1000;
    dt = TXT1_PERIOD_MS * periods;
    right = clip(right, COUNTS_MAX);
    left = clip(left, COUNTS_MAX);
    voltage1 = larger(0, smaller(voltage1, 65535));
    voltage2 = larger(0, smaller(voltage2, 65535));
    grow_older(b, dt);
    if (periods > 1) {
        b->late += periods - 1;
        if (periods > TXT1_MISSED_MAX)
            txt1_board_disarm(b, TXT1_MISSED);
    }
    control(b, dt);
    b->right = right;
    b->left = left;
    if (right || left || !(b->switches & TXT1_ATX))
        b->still_age = 0;
    advance(&b->odometry, right, left, periods);
    b->to_mode -= dt;
    if (b->to_mode <= 0) {
        b->to_mode += 1000;
        judge_link(b);
    }
    b->to_odometry -= dt;
    if (b->to_odometry <= 0) {
        b->to_odometry += 50;
        if (b->link_alive)
            send_odometry(b);
    }
    b->to_battery -= dt;
    if (b->to_battery <= 0) {
        b->to_battery += 1000;
        judge_batteries(b, voltage1, voltage2);
    }
    b->to_button -= dt;
    if (b->to_button <= 0) {
        b->to_button += 100;
        arm(b);
        press(b, buttons);
    }
    b->beeps = (b->beeps + dt) % (2 * TXT1_BEEP_LOW);
    b->buzzer = sounds(b);
}

const uint8_t *txt1_board_take(struct txt1_board *b, size_t *count)
{
    *count = (size_t)b->transmitter.length;
    b->transmitter.length = 0;
    return b->transmitter.buffer;
}

void txt1_board_begin(struct txt1_board *b, int32_t circumference, int32_t track, const char *identity)
{
    clear(b, sizeof *b);
    odometry_begin(&b->odometry, circumference, track);
    pid_begin(&b->linear, 128, TXT1_PWM_MAX);
    pid_begin(&b->angular, 16, TXT1_STEERING_MAX);
    b->identity = identity;
    b->switches = TXT1_ATX | TXT1_ESC;
    b->reason = TXT1_NOT_YET;
    b->buzzer = b->may_arm = true;
    b->battery_state = TXT1_EXTERNAL;
    b->age = b->manual_age = b->combined_age = b->wanted_age = b->byte_age = AGE_MAX;
}
