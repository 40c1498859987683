/* SPDX-License-Identifier: Apache-2.0 */
/*
 * choices.h: what the texts mean that a camera offers for its settings. Each maker
 * writes them in a way of its own: "1/250", "10/25", "1/1.3", "0.0040s", "2.5",
 * "30s", "2m", "1 1/3", "Bulb", "Auto ISO", "NEF (Raw)", "RAW + Large Fine JPEG".
 *
 * The texts come from a device, so anything may stand there. Pure functions.
 */
#ifndef CAPTURE_CHOICES_H
#define CAPTURE_CHOICES_H

#include "capture/camera.h"

/* An exposure time in seconds, 1 microsecond to a day; false for bulb, automatic and whatever else is no time. Without
 * a unit the number is in seconds; "m" and "min" are minutes. */
bool capture_choice_exposure(const char *text, double *seconds);

/* An ISO from 1 to 10 million, with or without "ISO" before it; false for "Auto" and for modes that happen to begin
 * with a number. */
bool capture_choice_iso(const char *text, double *iso);

/* An f-number from 0.5 to 128, with or without "f/" or "f" before it. */
bool capture_choice_aperture(const char *text, double *f_number);

/* How good a file format is for a bracket: 0: no RAW; 1: RAW and another file; 2: RAW of fewer pixels;
 * 3: compressed, perhaps with loss; 4: RAW. */
int capture_choice_raw(const char *text);

/* True for a file name that ends as RAW files of cameras do. `extension`, of 8 bytes, gets the part after the last dot
 * in lower case. */
bool capture_name_is_raw(const char *name, char extension[8]);

/* The choices that are numbers: values ascending, each with the text that sets it. */
typedef struct capture_stops {
    size_t count;
    double values[CAPTURE_STOPS_MAX];
    char texts[CAPTURE_STOPS_MAX][32];
} capture_stops;

/* Adds a choice if `parse` takes it. A value that is there already keeps its first text; texts of 32 bytes or more,
 * and more than CAPTURE_STOPS_MAX of them, are left out. */
void capture_stops_add(capture_stops *stops, const char *text, bool (*parse)(const char *text, double *value));

/* The index of the stop nearest to a value, as a ratio. There must be one. */
size_t capture_stops_nearest(const capture_stops *stops, double value);

#endif
