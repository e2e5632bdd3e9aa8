/*
 * A car with an ESC, a steering servo and two encoder wheels behind a Teensy 4, an ESP32 or an Arduino Uno R4: the board
 * at the other end of txt1's line. On the computer: txt1 run --port /dev/ttyACM0.
 *
 * Outputs are neutral from the first instruction on, as opening the port may reset the chip. They are neutral again when
 * the host is silent for 0.25 s, and the watchdog restarts the chip when this program hangs. This sketch has not been
 * tried on any of these boards.
 */
#include <txt1_board.h>

#if defined(ARDUINO_ARCH_ESP32)
#include <ESP32Servo.h>
#include <esp_task_wdt.h>
#elif defined(TEENSYDUINO)
#include <Servo.h>
#include <Watchdog_t4.h>
#else
#include <Servo.h>
#include <WDT.h>
#endif

/* pins: outputs, and the signals A and B of the encoders; every one of them takes an interrupt on a Teensy and an ESP32,
 * on an Uno R4 see its page */
const int MOTOR_PIN = 9, STEERING_PIN = 10;
const int RIGHT_A = 2, RIGHT_B = 3, LEFT_A = 4, LEFT_B = 5;
/* +1, or -1 for one that is wired or mounted the other way round */
const int MOTOR_SIGN = 1, STEERING_SIGN = 1, RIGHT_SIGN = 1, LEFT_SIGN = 1;
/* of a tyre, 0.1 mm, a multiple of 5; between the encoder wheels, mm */
const int32_t CIRCUMFERENCE = TXT1_CIRCUMFERENCE, TRACK = TXT1_TRACK_WIDTH;

const int NEUTRAL_US = 1500;
const unsigned long WATCHDOG_MS = 500;

Servo motor, steering;
txt1_board board;
unsigned long due_ms;

#if defined(TEENSYDUINO)
WDT_T4<WDT1> watchdog;
#endif

struct Wheel {
    int a, b, sign;
    volatile int32_t count;
    volatile uint8_t levels;
};

Wheel right_wheel = {RIGHT_A, RIGHT_B, RIGHT_SIGN, 0, 0};
Wheel left_wheel = {LEFT_A, LEFT_B, LEFT_SIGN, 0, 0};

/* by the levels AB before and after; forward, A comes before B */
const int8_t STEPS[16] = {0, -1, 1, 0, 1, 0, 0, -1, -1, 0, 0, 1, 0, 1, -1, 0};

void turned(Wheel &wheel) {
    uint8_t now = digitalRead(wheel.a) << 1 | digitalRead(wheel.b);
    wheel.count += wheel.sign * STEPS[wheel.levels << 2 | now];
    wheel.levels = now;
}

void right_turned() { turned(right_wheel); }
void left_turned() { turned(left_wheel); }

int32_t counts_of(Wheel &wheel) {
    noInterrupts();
    int32_t counts = wheel.count;
    wheel.count = 0;
    interrupts();
    return counts;
}

void begin_wheel(Wheel &wheel, void (*changed)()) {
    pinMode(wheel.a, INPUT_PULLUP);
    pinMode(wheel.b, INPUT_PULLUP);
    wheel.levels = digitalRead(wheel.a) << 1 | digitalRead(wheel.b);
    attachInterrupt(digitalPinToInterrupt(wheel.a), changed, CHANGE);
    attachInterrupt(digitalPinToInterrupt(wheel.b), changed, CHANGE);
}

/* counts of -24000 to 24000 as a pulse of 1000 to 2000 us */
int pulse_of(int32_t counts) {
    return NEUTRAL_US + (int)(counts / 48);
}

void begin_output(Servo &output, int pin) {
    /* a servo that sees no pulse stays where it is */
    pinMode(pin, OUTPUT);
    digitalWrite(pin, LOW);
    output.attach(pin, 1000, 2000);
    output.writeMicroseconds(NEUTRAL_US);
}

void begin_watchdog() {
#if defined(ARDUINO_ARCH_ESP32)
    esp_task_wdt_config_t given = {WATCHDOG_MS, 0, true};
    if (esp_task_wdt_reconfigure(&given) != ESP_OK)
        esp_task_wdt_init(&given);
    esp_task_wdt_add(NULL);
#elif defined(TEENSYDUINO)
    WDT_timings_t given;
    given.timeout = WATCHDOG_MS / 1000.0;
    watchdog.begin(given);
#else
    WDT.begin(WATCHDOG_MS);
#endif
}

void feed_watchdog() {
#if defined(ARDUINO_ARCH_ESP32)
    esp_task_wdt_reset();
#elif defined(TEENSYDUINO)
    watchdog.feed();
#else
    WDT.refresh();
#endif
}

void setup() {
    begin_output(motor, MOTOR_PIN);
    begin_output(steering, STEERING_PIN);
    begin_wheel(right_wheel, right_turned);
    begin_wheel(left_wheel, left_turned);
    txt1_board_begin(&board, CIRCUMFERENCE, TRACK, "txt1 C board");
    Serial.begin(57600);
    begin_watchdog();
    due_ms = millis();
}

void loop() {
    for (int k = 0; k < 64 && Serial.available() > 0; k++) {
        uint8_t byte = (uint8_t)Serial.read();
        txt1_board_receive(&board, &byte, 1);
    }
    unsigned long late = millis() - due_ms;
    if ((long)late >= 0) {
        int32_t periods = 1 + (int32_t)(late / TXT1_PERIOD_MS);
        due_ms += periods * TXT1_PERIOD_MS;
        txt1_board_step(&board, counts_of(right_wheel), counts_of(left_wheel), 0, 0, 0, periods);
        motor.writeMicroseconds(pulse_of(MOTOR_SIGN * board.outputs[0]));
        steering.writeMicroseconds(pulse_of(STEERING_SIGN * board.outputs[1]));
        feed_watchdog();
    }
    size_t count;
    const uint8_t *data = txt1_board_take(&board, &count);
    if (count)
        Serial.write(data, count);
}
