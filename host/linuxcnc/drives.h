/* Drives and motion controller, by their pins: nominal positions and measurements in, references and feedback out. */
#ifndef GANTRY_TAU_DRIVES_H
#define GANTRY_TAU_DRIVES_H

#include "pins.h"

/* Takes the nominal positions as those in force: at the start. */
void drives_start(const struct pins *pins);

/* True if each drive stands where its reference is, so that it can be switched on. */
int drives_are_near(const struct pins *pins);

/* Gives LinuxCNC the positions of the drives without the offsets in force; while they are off, the nominal positions in force. */
void drives_feedback(const struct pins *pins);

/* Reads nominal positions and measurements; while the drives are off, nominal positions that approach the drives. Returns 0 if one of them is not a number in range. */
int drives_read(const struct pins *pins, gt_tick_input *input);

/* Writes the references of a tick. */
void drives_write(const struct pins *pins, const gt_tick_input *input, const gt_tick_output *output);

/* Holds the offsets over a cycle without a tick: the references follow the path. */
void drives_hold(const struct pins *pins);

#endif
