/* SPDX-License-Identifier: Apache-2.0 */
/* sim_fault.c: the list of mishaps of the simulated camera. */
#include "capture/sim_fault.h"

#include <string.h>

static const char *const kinds[CAPTURE_FAULT_KINDS] = {"busy", "drop",    "disconnect", "full", "cut",   "exif",
                                                       "iso",  "shutter", "locked",     "same", "black", "bump"};

const char *capture_fault_name(int bit) {
    return bit >= 0 && bit < CAPTURE_FAULT_KINDS ? kinds[bit] : NULL;
}

/* Digits only, at most nine. */
static const char *parse_count(const char *text, uint64_t *value) {
    int n = 0;
    for (*value = 0; text[n] >= '0' && text[n] <= '9' && n < 9; n++)
        *value = *value * 10 + (uint64_t)(text[n] - '0');
    return n > 0 ? text + n : NULL;
}

brace_status capture_faults_parse(capture_faults *out, const char *text, brace_error *error) {
    out->count = 0;
    for (const char *item = text;;) {
        const size_t length = strcspn(item, ","), name = strcspn(item, ":,");
        const char *rest = item[name] == ':' ? item + name + 1 : NULL;
        unsigned kind = 0;
        uint64_t first = 0, last = 0;
        for (int i = 0; i < CAPTURE_FAULT_KINDS; i++)
            kind |= strlen(kinds[i]) == name && strncmp(kinds[i], item, name) == 0 ? 1u << i : 0;
        rest = rest != NULL ? parse_count(rest, &first) : NULL;
        last = first;
        if (rest != NULL && *rest == '+')
            rest++, last = UINT64_MAX;
        else if (rest != NULL && *rest == '-')
            rest = parse_count(rest + 1, &last);
        if (kind == 0 || rest != item + length || first < 1 || last < first)
            return core_fail(error, BRACE_ERROR_ARGUMENT,
                             "'%.*s' is no fault: KIND:N, KIND:N-M or KIND:N+, with busy, drop, disconnect, full, cut, "
                             "exif, iso, shutter, locked, same, black or bump",
                             (int)(length < 60 ? length : 60), item);
        if (out->count == CAPTURE_FAULTS_MAX)
            return core_fail(error, BRACE_ERROR_ARGUMENT, "%d faults at most", CAPTURE_FAULTS_MAX);
        out->at[out->count].kind = kind;
        out->at[out->count].first = first;
        out->at[out->count++].last = last;
        if (item[length] == '\0')
            return BRACE_OK;
        item += length + 1;
    }
}

unsigned capture_faults_at(const capture_faults *faults, uint64_t call) {
    unsigned kind = 0;
    for (size_t i = 0; i < faults->count; i++)
        if (call >= faults->at[i].first && call <= faults->at[i].last)
            kind |= faults->at[i].kind;
    return kind;
}
