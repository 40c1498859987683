/* SPDX-License-Identifier: Apache-2.0 */
/* ptpip_device.c: see ptpip_device.h. */
#include "ptpip_device.h"

#include <string.h>

#define COUNT(a) (sizeof(a) / sizeof(a)[0])
#define FRACTION(n, d) ((uint32_t)(n) << 16 | (uint32_t)(d))
#define BULB 0xffffffffu
#define FLASH 0xfffffffeu
#define TIME 0xfffffffdu

enum { FORMAT_ASSOCIATION = 0x3001, FORMAT_JPEG = 0x3801, FORMAT_DNG = 0x3811 };
enum { MAKER_JPEG = 2, MAKER_RAW = 4, MAKER_BOTH = 5 };

/* Tenths of milliseconds. */
static const uint32_t tenths[] = {2,    4,    5,    8,    10,   13,   16,   20,   25,   31,   40,    50,
                                  63,   80,   100,  125,  160,  200,  250,  320,  400,  500,  640,   800,
                                  1000, 1280, 1600, 2000, 2560, 3200, 4000, 5120, 6400, 8000, 10240, 20480};
static const uint32_t fractions[] = {FRACTION(1, 4000),
                                     FRACTION(1, 2000),
                                     FRACTION(1, 1000),
                                     FRACTION(1, 500),
                                     FRACTION(1, 250),
                                     FRACTION(1, 125),
                                     FRACTION(1, 60),
                                     FRACTION(1, 30),
                                     FRACTION(1, 16),
                                     FRACTION(10, 80),
                                     FRACTION(10, 40),
                                     FRACTION(10, 25),
                                     FRACTION(5, 10),
                                     FRACTION(1, 1),
                                     FRACTION(2, 1),
                                     BULB,
                                     TIME,
                                     FLASH};
static const uint32_t isos[] = {25, 50, 100, 200, 400, 800, 1600, 3200, 6400};
static const uint32_t apertures[] = {280, 400, 560, 800};
static const uint32_t balances[] = {2, 4, 5, 6};
static const uint32_t programs[] = {1, 2, 3, 4};
static const uint32_t focuses[] = {1, 2};
static const uint32_t modes[] = {1, 2};
static const uint32_t formats[] = {0, 1, MAKER_JPEG, MAKER_BOTH, MAKER_RAW};
static const uint32_t only_jpeg[] = {0, 1, MAKER_JPEG};

static void add(ptpip_device *device, uint16_t code, uint16_t type, bool writable, uint32_t value,
                const uint32_t *choices, size_t count) {
    device->properties[device->property_count++] = (ptpip_property){code, type, writable, value, value, choices, count};
}

static void folder(ptpip_device *device, uint32_t handle, uint32_t parent, const char *name) {
    ptpip_object *o = &device->objects[device->object_count++];
    *o = (ptpip_object){.handle = handle, .parent = parent, .format = FORMAT_ASSOCIATION};
    snprintf(o->name, sizeof o->name, "%s", name);
}

void ptpip_device_init(ptpip_device *device, const ptpip_params *params) {
    memset(device, 0, sizeof *device);
    device->maker = params->maker;
    if (params->maker) {
        if (params->jpeg_only) {
            add(device, PTP_COMPRESSION, 2, true, MAKER_JPEG, only_jpeg, COUNT(only_jpeg));
        } else {
            add(device, PTP_COMPRESSION, 2, true, MAKER_JPEG, formats, COUNT(formats) - (params->both ? 1 : 0));
        }
        add(device, PTP_MAKER_EXPOSURE, 6, true, FRACTION(1, 125), fractions, COUNT(fractions));
    }
    add(device, PTP_EXPOSURE_TIME, 6, !params->maker, 80, tenths, COUNT(tenths));
    add(device, PTP_EXPOSURE_INDEX, 4, true, 400, isos, COUNT(isos));
    add(device, PTP_F_NUMBER, 4, true, 400, apertures, COUNT(apertures));
    add(device, PTP_WHITE_BALANCE, 4, true, 2, balances, COUNT(balances));
    add(device, PTP_FOCUS_MODE, 4, true, 2, focuses, COUNT(focuses));
    add(device, PTP_PROGRAM, 4, !params->program, params->program ? 2 : 1, programs, COUNT(programs));
    add(device, PTP_CAPTURE_MODE, 4, true, 1, modes, COUNT(modes));
    folder(device, 1, 0, "DCIM");
    folder(device, 2, 1, "100BRACE");
}

void ptpip_device_free(ptpip_device *device) {
    for (size_t i = 0; i < device->object_count; i++) {
        core_free(device->objects[i].data);
    }
}

ptpip_property *ptpip_device_property(ptpip_device *device, uint32_t code) {
    for (size_t i = 0; i < device->property_count; i++) {
        if (device->properties[i].code == code) {
            return &device->properties[i];
        }
    }
    return NULL;
}

ptpip_object *ptpip_device_object(ptpip_device *device, uint32_t handle) {
    for (size_t i = 0; handle != 0 && i < device->object_count; i++) {
        if (device->objects[i].handle == handle) {
            return &device->objects[i];
        }
    }
    return NULL;
}

double ptpip_device_exposure(ptpip_device *device) {
    const ptpip_property *p = ptpip_device_property(device, PTP_MAKER_EXPOSURE);
    if (p != NULL) {
        return (double)(p->value >> 16) / (double)(p->value & 0xffff);
    }
    return ptpip_device_property(device, PTP_EXPOSURE_TIME)->value * 1e-4;
}

double ptpip_device_iso(ptpip_device *device) {
    return ptpip_device_property(device, PTP_EXPOSURE_INDEX)->value;
}

bool ptpip_device_restored(const ptpip_device *device) {
    for (size_t i = 0; i < device->property_count; i++) {
        if (device->properties[i].value != device->properties[i].initial) {
            return false;
        }
    }
    return true;
}

unsigned ptpip_device_set(ptpip_property *property, ptpip_reader *r, bool keep) {
    const uint32_t value = property->type == 2 ? ptpip_get8(r) : property->type == 4 ? ptpip_get16(r) : ptpip_get32(r);
    if (r->bad || r->at != r->size) {
        return PTP_INVALID_PROPERTY_VALUE;
    }
    if (!property->writable) {
        return PTP_ACCESS_DENIED;
    }
    for (size_t i = 0; i < property->count; i++) {
        if (property->choices[i] == value) {
            property->value = keep ? property->value : value;
            return PTP_OK;
        }
    }
    return PTP_INVALID_PROPERTY_VALUE;
}

uint32_t ptpip_device_add(ptpip_device *device, void *data, size_t size, bool jpeg) {
    if (device->object_count == PTPIP_OBJECTS_MAX) {
        core_free(data);
        return 0;
    }
    ptpip_object *o = &device->objects[device->object_count++];
    device->pictures++;
    *o = (ptpip_object){.handle = 0x100 + device->pictures,
                        .parent = 2,
                        .format = jpeg ? FORMAT_JPEG : FORMAT_DNG,
                        .data = data,
                        .size = size};
    snprintf(o->name, sizeof o->name, "BRC_%04u.%s", device->pictures, jpeg ? "JPG" : "DNG");
    return o->handle;
}

void ptpip_device_delete(ptpip_object *object) {
    core_free(object->data);
    object->data = NULL;
    object->handle = 0;
}

void ptpip_write_device_info(ptpip_writer *w, const ptpip_device *device) {
    static const uint16_t operations[] = {PTP_GET_DEVICE_INFO,    PTP_OPEN_SESSION,     PTP_CLOSE_SESSION,
                                          PTP_GET_STORAGE_IDS,    PTP_GET_STORAGE_INFO, PTP_GET_NUM_OBJECTS,
                                          PTP_GET_OBJECT_HANDLES, PTP_GET_OBJECT_INFO,  PTP_GET_OBJECT,
                                          PTP_DELETE_OBJECT,      PTP_INITIATE_CAPTURE, PTP_GET_PROPERTY_DESCRIPTION,
                                          PTP_GET_PROPERTY,       PTP_SET_PROPERTY,     PTP_GET_PARTIAL_OBJECT};
    static const uint16_t events[] = {PTP_OBJECT_ADDED, PTP_CAPTURE_COMPLETE};
    static const uint16_t pictures[] = {FORMAT_DNG, FORMAT_JPEG};
    uint16_t properties[PTPIP_PROPERTIES_MAX];
    for (size_t i = 0; i < device->property_count; i++) {
        properties[i] = device->properties[i].code;
    }
    ptpip_put16(w, 100);                      /* version of the standard, hundredths */
    ptpip_put32(w, device->maker ? 0x0a : 0); /* whose properties those above 0xD000 are */
    ptpip_put16(w, device->maker ? 100 : 0);
    ptpip_put_string(w, "");
    ptpip_put16(w, 0); /* functional mode: standard */
    ptpip_put_array16(w, operations, COUNT(operations));
    ptpip_put_array16(w, events, COUNT(events));
    ptpip_put_array16(w, properties, device->property_count);
    ptpip_put_array16(w, pictures, COUNT(pictures)); /* what a capture makes */
    ptpip_put_array16(w, pictures, COUNT(pictures)); /* what it can show */
    ptpip_put_string(w, "BRACE");
    ptpip_put_string(w, device->maker ? "Test Camera M" : "Test Camera");
    ptpip_put_string(w, "1.0");
    ptpip_put_string(w, "000001");
}

void ptpip_write_storage_info(ptpip_writer *w) {
    ptpip_put16(w, 4); /* removable RAM */
    ptpip_put16(w, 3); /* DCF */
    ptpip_put16(w, 0); /* read and write */
    ptpip_put32(w, 0); /* 4 GiB, */
    ptpip_put32(w, 1);
    ptpip_put32(w, 0x80000000u); /* half of it free */
    ptpip_put32(w, 0);
    ptpip_put32(w, 100);
    ptpip_put_string(w, "card");
    ptpip_put_string(w, "BRACE");
}

void ptpip_write_handles(ptpip_writer *w, const ptpip_device *device, uint32_t parent) {
    uint32_t count = 0;
    const size_t at = w->size;
    ptpip_put32(w, 0);
    for (size_t i = 0; i < device->object_count; i++) {
        const ptpip_object *o = &device->objects[i];
        if (o->handle != 0 && (parent == 0 || o->parent == (parent == PTP_ROOT ? 0 : parent))) {
            ptpip_put32(w, o->handle);
            count++;
        }
    }
    if (!w->bad) {
        ptpip_put32(&(ptpip_writer){.data = w->data + at, .capacity = 4}, count);
    }
}

void ptpip_write_object_info(ptpip_writer *w, const ptpip_object *object) {
    const bool is_folder = object->format == FORMAT_ASSOCIATION;
    ptpip_put32(w, PTP_STORAGE);
    ptpip_put16(w, object->format);
    ptpip_put16(w, 0); /* not protected */
    ptpip_put32(w, (uint32_t)object->size);
    ptpip_put16(w, is_folder ? 0 : FORMAT_JPEG); /* thumbnail: */
    for (int i = 0; i < 6; i++) {                /* bytes, size, size of the picture, bits */
        ptpip_put32(w, 0);
    }
    ptpip_put32(w, object->parent);
    ptpip_put16(w, is_folder ? 1 : 0); /* a folder as one knows it */
    ptpip_put32(w, 0);
    ptpip_put32(w, 0); /* sequence number */
    ptpip_put_string(w, object->name);
    ptpip_put_string(w, "20240501T120000");
    ptpip_put_string(w, "20240501T120000");
    ptpip_put_string(w, "");
}

void ptpip_write_value(ptpip_writer *w, const ptpip_property *property, uint32_t value) {
    if (property->type == 2) {
        ptpip_put8(w, value);
    } else if (property->type == 4) {
        ptpip_put16(w, value);
    } else {
        ptpip_put32(w, value);
    }
}

void ptpip_write_property(ptpip_writer *w, const ptpip_property *property) {
    ptpip_put16(w, property->code);
    ptpip_put16(w, property->type);
    ptpip_put8(w, property->writable ? 1 : 0);
    ptpip_write_value(w, property, property->initial);
    ptpip_write_value(w, property, property->value);
    ptpip_put8(w, 2); /* one of: */
    ptpip_put16(w, (unsigned)property->count);
    for (size_t i = 0; i < property->count; i++) {
        ptpip_write_value(w, property, property->choices[i]);
    }
}
