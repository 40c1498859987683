/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ptpip_camera.h: a small camera for the tests, as libgphoto2 sees one over
 * PTP/IP: it listens on the loopback interface only, has a shutter, an ISO, an
 * aperture and a folder of pictures, and can be told to fail.
 *
 * It speaks PTP (ISO 15740): device info, session, storages, objects, properties,
 * InitiateCapture and the events that follow it. One computer at a time. It runs
 * in a thread of its own; all functions may be called from any thread.
 */
#ifndef PTPIP_CAMERA_H
#define PTPIP_CAMERA_H

#include "core/core.h"

/* What can go wrong. "of the command" faults count the command's occurrences since the start. */
typedef enum ptpip_fault_kind {
    PTPIP_FAULT_BUSY_OPEN,     /* Device Busy to OpenSession */
    PTPIP_FAULT_BUSY_SET,      /* Device Busy to SetDevicePropValue of exposure or ISO */
    PTPIP_FAULT_BUSY_SHOOT,    /* Device Busy to InitiateCapture */
    PTPIP_FAULT_BUSY_DOWNLOAD, /* Device Busy to GetObject and GetPartialObject */
    PTPIP_FAULT_BUSY_READ,     /* Device Busy to GetDevicePropDesc of exposure or ISO */
    PTPIP_FAULT_DROP_READ,     /* the connection ends instead of an answer to GetDevicePropDesc */
    PTPIP_FAULT_DROP_SET,      /* the connection ends instead of an answer to SetDevicePropValue */
    PTPIP_FAULT_DROP_SHOOT,    /* the connection ends instead of an answer to InitiateCapture */
    PTPIP_FAULT_DROP_EXPOSE,   /* the connection ends after the answer, before the picture is there */
    PTPIP_FAULT_DROP_DOWNLOAD, /* the connection ends in the middle of a picture */
    PTPIP_FAULT_NO_OBJECT,     /* CaptureComplete, but no ObjectAdded */
    PTPIP_FAULT_NO_EVENT,      /* neither of them, ever */
    PTPIP_FAULT_REFUSE,        /* Access Denied to SetDevicePropValue of exposure or ISO */
    PTPIP_FAULT_KEEP,          /* "OK" to SetDevicePropValue of exposure or ISO, and the old value stays */
    PTPIP_FAULT_LIE,           /* the new value is there to read, but the picture is taken with the old one */
    PTPIP_FAULT_TRUNCATE,      /* half of a picture is sent where the whole was announced */
    PTPIP_FAULT_JPEG,          /* a JPEG instead of a RAW file */
    PTPIP_FAULT_FULL,          /* Store Full to InitiateCapture */
    PTPIP_FAULT_HANG,          /* no answer to InitiateCapture, and no picture */
    PTPIP_FAULT_LENGTH,        /* an answer to InitiateCapture that claims to be 2 GiB long */
    PTPIP_FAULT_COUNT
} ptpip_fault_kind;

typedef struct ptpip_fault {
    ptpip_fault_kind kind;
    unsigned from;  /* the first occurrence of the command that it befalls, from 1 */
    unsigned times; /* how many from there; UINT_MAX: all */
} ptpip_fault;

const char *ptpip_fault_name(ptpip_fault_kind kind);

/* "NAME", "NAME@FROM" or "NAME@FROMxTIMES" ("busy-shoot@2x3"); TIMES may be "all". False if it is none of these. */
bool ptpip_fault_parse(ptpip_fault *out, const char *text);

/* A picture: the bytes of the file that a shot makes, freed with core_free. */
typedef brace_status ptpip_expose_fn(void *user, double seconds, double iso, void **data, size_t *size,
                                     brace_error *error);

#define PTPIP_FAULTS_MAX 16

typedef struct ptpip_params {
    uint16_t port; /* 0: any that is free */

    /* As a maker's camera: exposures as fractions under the maker's own property, "Bulb" and "Time" among them, and a
     * choice of formats that begins at JPEG. Otherwise what the standard has: exposures in tenths of milliseconds,
     * pictures always RAW. */
    bool maker;
    bool jpeg_only; /* with `maker`: the format cannot be changed from JPEG */
    bool both;      /* with `maker`: "RAW" gives a JPEG too, which comes first */
    bool program;   /* the mode dial is at P, and cannot be turned from the computer */

    const ptpip_fault *faults;
    size_t fault_count; /* at most PTPIP_FAULTS_MAX */

    ptpip_expose_fn *expose; /* called from the camera's thread */
    void *user;
} ptpip_params;

/* What happened so far. */
typedef struct ptpip_tally {
    unsigned connections; /* sessions opened */
    unsigned sets;        /* SetDevicePropValue, in all */
    unsigned releases;    /* InitiateCapture, in all */
    unsigned exposures;   /* pictures made */
    unsigned downloads;   /* pictures sent in whole */
    unsigned deleted;
    unsigned faults;   /* of those asked for */
    unsigned rejected; /* packets that were none */
    bool restored;     /* every property has the value that it began with */
} ptpip_tally;

typedef struct ptpip_camera ptpip_camera;

brace_status ptpip_camera_start(ptpip_camera **out, const ptpip_params *params, brace_error *error);
uint16_t ptpip_camera_port(const ptpip_camera *camera);
ptpip_tally ptpip_camera_tally(ptpip_camera *camera);
void ptpip_camera_stop(ptpip_camera *camera); /* NULL is allowed */

#endif
