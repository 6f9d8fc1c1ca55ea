/* SPDX-License-Identifier: MIT */
/* motors.h - your robot's wheels. motors_set is called some 200 times a second: let a watchdog
 * stop the motors where it is not called for 100 ms. */
#ifndef MOTORS_H
#define MOTORS_H

#include <stdint.h>

void motors_begin(void);
void motors_set(int16_t left_steps_s, int16_t right_steps_s);

#endif
