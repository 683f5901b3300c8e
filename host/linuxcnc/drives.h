/* Drives and motion controller, by their pins: nominal positions and measurements in, references and feedback out. */
#ifndef GANTRY_TAU_DRIVES_H
#define GANTRY_TAU_DRIVES_H

#include <stddef.h>

#include "pins.h"

/* Gives LinuxCNC the positions of the drives without the offsets in force; while they are off, the nominal positions in force. */
void drives_feedback(const struct pins *pins);

/*
 * Reads nominal positions and measurements; while the drives are off, nominal positions that approach the drives. Returns 0 if one of them is
 * not a number in range.
 */
int drives_read(const struct pins *pins);

/* Makes what was read last the input of the next tick. */
void drives_accept(gt_tick_input *input);

/* Takes the nominal positions that were accepted as those in force: at the start. */
void drives_start(void);

/*
 * True if every joint agrees with its reference, so that its drive can be switched on: the drive stands where its reference is, and
 * LinuxCNC's command is the nominal position in force. Otherwise, if `text` is not NULL, one line about the first joint that does not.
 */
int drives_agree(const struct pins *pins, char *text, size_t size);

/* Writes the references of a tick. */
void drives_write(const struct pins *pins, const gt_tick_input *input, const gt_tick_output *output);

/* Writes the references of a cycle without a tick. */
void drives_hold(const struct pins *pins, const gt_held *held);

#endif
