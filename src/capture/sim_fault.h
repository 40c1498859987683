/* SPDX-License-Identifier: Apache-2.0 */
/*
 * sim_fault.h: what the simulated camera can be told to do wrong. "busy:2" fails
 * the second time that the shutter is asked for, "drop:3-5" the third to fifth,
 * "full:4+" from the fourth on; several are separated by commas.
 */
#ifndef CAPTURE_SIM_FAULT_H
#define CAPTURE_SIM_FAULT_H

#include "core/core.h"

enum {
    CAPTURE_FAULT_BUSY = 1 << 0,       /* has no time */
    CAPTURE_FAULT_DROP = 1 << 1,       /* exposes, and no frame arrives */
    CAPTURE_FAULT_DISCONNECT = 1 << 2, /* is gone until it is opened again */
    CAPTURE_FAULT_FULL = 1 << 3,       /* the computer's disk is full */
    CAPTURE_FAULT_CUT = 1 << 4,        /* half of the file arrives */
    CAPTURE_FAULT_EXIF = 1 << 5,       /* right exposure, a quarter of it in the file */
    CAPTURE_FAULT_ISO = 1 << 6,        /* shoots at four times the ISO, and says so */
    CAPTURE_FAULT_SHUTTER = 1 << 7,    /* shoots a quarter of the time, and says otherwise */
    CAPTURE_FAULT_LOCKED = 1 << 8,     /* the exposure of the shot before, and says so */
    CAPTURE_FAULT_SAME = 1 << 9,       /* the frame before once more, under new metadata */
    CAPTURE_FAULT_BLACK = 1 << 10,     /* the lens cap is on */
    CAPTURE_FAULT_BUMP = 1 << 11,      /* somebody kicks the tripod: it stands elsewhere from then on */
    CAPTURE_FAULT_KINDS = 12
};

enum { CAPTURE_FAULTS_MAX = 64 };

typedef struct capture_faults {
    size_t count;
    struct {
        unsigned kind;
        uint64_t first, last; /* calls of the shutter, from 1 */
    } at[CAPTURE_FAULTS_MAX];
} capture_faults;

brace_status capture_faults_parse(capture_faults *out, const char *text, brace_error *error);
unsigned capture_faults_at(const capture_faults *faults, uint64_t call); /* the kinds, or-ed */
const char *capture_fault_name(int bit);                                 /* "busy" for bit 0; NULL after the last */

#endif
