/*
 * The board at the other end of txt1's line: its protocol, velocity loops, odometry and safety gate, in portable C.
 *
 * It allocates nothing, needs no library, and knows no hardware and no clock. Its owner hands in the host's bytes
 * (txt1_board_receive), and every 20 ms the wheels' counts and the voltages (txt1_board_step). Then the owner puts out
 * `outputs` and `switches`, and sends what txt1_board_take returns. Nothing moves before a host has sent gains and
 * set-points; all that stops the motor leaves the outputs at 0.
 *
 * It is the core of the Pico's firmware (firmware/pico/txt1pico) in C, in whole numbers, and answers byte for byte as
 * this core does. Units: mm/s and mrad/s, PWM counts (24000 is 0.5 ms from neutral), mV.
 */
#ifndef TXT1_BOARD_H
#define TXT1_BOARD_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "txt1_facts.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TXT1_PERIOD_MS 20
/* ms without a byte after which a half frame is given up */
#define TXT1_SILENCE_MS 60
/* bytes that wait for the rest of a frame; the longest frame has 242 */
#define TXT1_RECEIVED 512
/* bytes that wait for their way to the host */
#define TXT1_SENT 256

/* bits of `switches` */
#define TXT1_ATX 1
#define TXT1_ESC 2

/* button of `txt1_board_step`: manual mode on and off */
#define TXT1_CENTRE 16

/* why the gate is closed */
enum txt1_reason {
    TXT1_ARMED,
    TXT1_NOT_YET,
    TXT1_LINK_LOST,
    TXT1_RUNAWAY,
    TXT1_BATTERIES_BAD,
    TXT1_CUT_OFF_REACHED,
    TXT1_MISSED,
    TXT1_ATX_OFF,
    TXT1_FAULT,
    TXT1_RELEASED
};

enum txt1_battery { TXT1_EXTERNAL, TXT1_BATTERY_GOOD, TXT1_BATTERY_WARNING, TXT1_BATTERY_BAD };

/* a velocity-form PID loop; errors in parts of 1 mm/s or 1 mrad/s, gains in thousandths */
struct txt1_pid {
    int32_t limit, half, whole;
    int32_t output, counts, rest, error, before;
};

struct txt1_odometry {
    /* mm, mrad; 1/128 mm/s, 1/16 mrad/s */
    int32_t x, y, theta, v, omega;
    int32_t circumference, path, turn, track, turn_high, turn_low;
    int32_t heading, more, half_x, half_y, x_rest, y_rest;
};

struct txt1_receiver {
    uint8_t buffer[TXT1_RECEIVED];
    int32_t start, end, settled;
    int32_t damaged, foreign, lost;
    bool refused;
};

struct txt1_transmitter {
    uint8_t buffer[TXT1_SENT];
    int32_t length, lost, at;
};

struct txt1_watch {
    int32_t fast, apart, against, right, left, right_passed, left_passed;
};

/* All of the board. Read what has a comment; the rest is its own. */
struct txt1_board {
    /* PWM counts of motor, front, rear, and of two free servos */
    int32_t outputs[5];
    /* which supplies are on: TXT1_ATX, TXT1_ESC */
    int32_t switches;
    /* whether the gate is open, else why it is closed; whether the host is heard; whether the buzzer sounds */
    bool armed;
    enum txt1_reason reason;
    bool link_alive;
    bool buzzer;
    /* frames from the host, and cycles that were missed */
    int32_t received, late;
    enum txt1_battery battery_state;

    struct txt1_odometry odometry;
    struct txt1_receiver receiver;
    struct txt1_transmitter transmitter;
    struct txt1_watch watch;
    struct txt1_pid linear, angular;
    int32_t linear_gains[3];
    int32_t sets[4 * TXT1_SETS_MAX];
    int32_t set_count;
    const char *identity;
    bool manual, combined_selected, released, may_arm, was_manual, smoothed, epoch_ok, manual_ok;
    int32_t v, omega, asked_v, asked_omega, right, left;
    int32_t voltage1, voltage2;
    int32_t age, manual_age, combined_age, wanted_age, byte_age, still_age, bad_age;
    int32_t manual_pwm[3], servos[2];
    int32_t combined_v, combined_omega, velocities, combined;
    int32_t pressed, beeps, to_mode, to_battery, to_odometry, to_button;
};

/*
 * Begin: the gate is closed, all outputs are 0, all gains 0.
 * circumference: of a tyre, 0.1 mm, a multiple of 5; track: between the encoder wheels, mm; both as TXT1_CIRCUMFERENCE and
 * TXT1_TRACK_WIDTH by default. identity: told on request, at most 63 characters; the caller keeps it.
 */
void txt1_board_begin(struct txt1_board *board, int32_t circumference, int32_t track, const char *identity);

/* Take bytes of the host, and obey the frames that they complete. */
void txt1_board_receive(struct txt1_board *board, const uint8_t *data, size_t count);

/*
 * Run the cycle that is due every 20 ms. right, left: counts of the encoders since the last one, forward positive;
 * voltage1, voltage2: mV, 0 where no pack is; buttons: TXT1_CENTRE or 0; periods: of 20 ms since the last cycle, at
 * least 1.
 */
void txt1_board_step(struct txt1_board *board, int32_t right, int32_t left, int32_t voltage1, int32_t voltage2,
                     int32_t buttons, int32_t periods);

/* Close the gate, such as after a fault of the owner's: outputs neutral at once. */
void txt1_board_disarm(struct txt1_board *board, enum txt1_reason reason);

/* Return the bytes for the host and their number, and begin anew: they stay valid until the next call of another. */
const uint8_t *txt1_board_take(struct txt1_board *board, size_t *count);

#ifdef __cplusplus
}
#endif

#endif
