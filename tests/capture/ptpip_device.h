/* SPDX-License-Identifier: Apache-2.0 */
/*
 * ptpip_device.h: what the test camera is made of: its properties and the
 * pictures on its card, and how PTP writes them down. No sockets, no threads.
 */
#ifndef PTPIP_DEVICE_H
#define PTPIP_DEVICE_H

#include "ptpip_camera.h"
#include "ptpip_wire.h"

enum { /* operations (ISO 15740, 10.4) */
       PTP_GET_DEVICE_INFO = 0x1001,
       PTP_OPEN_SESSION = 0x1002,
       PTP_CLOSE_SESSION = 0x1003,
       PTP_GET_STORAGE_IDS = 0x1004,
       PTP_GET_STORAGE_INFO = 0x1005,
       PTP_GET_NUM_OBJECTS = 0x1006,
       PTP_GET_OBJECT_HANDLES = 0x1007,
       PTP_GET_OBJECT_INFO = 0x1008,
       PTP_GET_OBJECT = 0x1009,
       PTP_DELETE_OBJECT = 0x100B,
       PTP_INITIATE_CAPTURE = 0x100E,
       PTP_GET_PROPERTY_DESCRIPTION = 0x1014,
       PTP_GET_PROPERTY = 0x1015,
       PTP_SET_PROPERTY = 0x1016,
       PTP_GET_PARTIAL_OBJECT = 0x101B
};

enum { /* responses (11.3) */
       PTP_OK = 0x2001,
       PTP_GENERAL_ERROR = 0x2002,
       PTP_SESSION_NOT_OPEN = 0x2003,
       PTP_OPERATION_NOT_SUPPORTED = 0x2005,
       PTP_INVALID_STORAGE = 0x2008,
       PTP_INVALID_OBJECT = 0x2009,
       PTP_PROPERTY_NOT_SUPPORTED = 0x200A,
       PTP_STORE_FULL = 0x200C,
       PTP_ACCESS_DENIED = 0x200F,
       PTP_DEVICE_BUSY = 0x2019,
       PTP_INVALID_PROPERTY_VALUE = 0x201C,
       PTP_INVALID_PARAMETER = 0x201D,
       PTP_SESSION_ALREADY_OPEN = 0x201E
};

enum { /* events (12.5) */
       PTP_OBJECT_ADDED = 0x4002,
       PTP_CAPTURE_COMPLETE = 0x400D
};

enum { /* properties (13.5), and the maker's exposure time */
       PTP_COMPRESSION = 0x5004,
       PTP_WHITE_BALANCE = 0x5005,
       PTP_F_NUMBER = 0x5007,
       PTP_FOCUS_MODE = 0x500A,
       PTP_EXPOSURE_TIME = 0x500D,
       PTP_PROGRAM = 0x500E,
       PTP_EXPOSURE_INDEX = 0x500F,
       PTP_CAPTURE_MODE = 0x5013,
       PTP_MAKER_EXPOSURE = 0xD100
};

#define PTP_STORAGE 0x00010001u
#define PTP_ROOT 0xffffffffu

typedef struct ptpip_property {
    uint16_t code, type; /* type: 2, 4, 6: unsigned, 1, 2 or 4 bytes */
    bool writable;
    uint32_t initial, value;
    const uint32_t *choices;
    size_t count;
} ptpip_property;

typedef struct ptpip_object {
    uint32_t handle, parent; /* handle 0: deleted */
    uint16_t format;
    char name[32];
    uint8_t *data; /* core_alloc'ed */
    size_t size;
} ptpip_object;

#define PTPIP_OBJECTS_MAX 512
#define PTPIP_PROPERTIES_MAX 12

typedef struct ptpip_device {
    bool maker;
    ptpip_property properties[PTPIP_PROPERTIES_MAX];
    size_t property_count;
    ptpip_object objects[PTPIP_OBJECTS_MAX];
    size_t object_count;
    unsigned pictures;
} ptpip_device;

void ptpip_device_init(ptpip_device *device, const ptpip_params *params);
void ptpip_device_free(ptpip_device *device);

ptpip_property *ptpip_device_property(ptpip_device *device, uint32_t code); /* NULL: there is none */
ptpip_object *ptpip_device_object(ptpip_device *device, uint32_t handle);

/* Seconds and ISO that the properties stand for. */
double ptpip_device_exposure(ptpip_device *device);
double ptpip_device_iso(ptpip_device *device);
bool ptpip_device_restored(const ptpip_device *device);

/* Sets a value that came in `r`: the response. */
unsigned ptpip_device_set(ptpip_property *property, ptpip_reader *r, bool keep);

/* Puts a picture on the card, takes `data`; its handle, or 0 if there is no room (`data` is freed then). */
uint32_t ptpip_device_add(ptpip_device *device, void *data, size_t size, bool jpeg);
void ptpip_device_delete(ptpip_object *object);

void ptpip_write_device_info(ptpip_writer *w, const ptpip_device *device);
void ptpip_write_storage_info(ptpip_writer *w);
void ptpip_write_handles(ptpip_writer *w, const ptpip_device *device, uint32_t parent);
void ptpip_write_object_info(ptpip_writer *w, const ptpip_object *object);
void ptpip_write_property(ptpip_writer *w, const ptpip_property *property);
void ptpip_write_value(ptpip_writer *w, const ptpip_property *property, uint32_t value);

#endif
