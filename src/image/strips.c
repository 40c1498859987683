/* SPDX-License-Identifier: Apache-2.0 */
/*
 * strips.c: deflate on all threads. A picture is cut into strips of fixed
 * height; each is prepared (converted, filtered) and deflated by itself, and they
 * are emitted in order. For PNG the strips are joined into one zlib stream: all
 * but the last end with a full flush, as RFC 1951 allows at any byte boundary.
 */
#include <string.h>

#define ZLIB_CONST
#include <zlib.h>

#include "image/image.h"

typedef struct strip_slot {
    unsigned char *packed;
    size_t size;
    uint32_t rows;
    uLong adler; /* of the bytes before compression */
    int code;    /* of zlib */
} strip_slot;

/* One worker's buffers. */
typedef struct strip_worker {
    unsigned char *plain, *row;
    float *scratch;
} strip_worker;

typedef struct strip_run {
    const image_strips *strips;
    uint32_t first, count; /* strips in the picture: `first` is that of slot 0 */
    strip_slot *slots;
    strip_worker *workers;
    size_t capacity; /* of slot.packed */
} strip_run;

static void *z_alloc(void *opaque, unsigned count, unsigned size) {
    (void)opaque;
    return core_alloc(count, size);
}

static void z_free(void *opaque, void *p) {
    (void)opaque;
    core_free(p);
}

static int deflate_strip(const strip_run *run, strip_slot *slot, const unsigned char *plain, size_t size, bool last) {
    const image_strips *s = run->strips;
    z_stream z;
    memset(&z, 0, sizeof z);
    z.zalloc = z_alloc;
    z.zfree = z_free;
    int code = deflateInit2(&z, s->level, Z_DEFLATED, s->one_stream ? -15 : 15, 9, s->strategy);
    if (code != Z_OK) {
        return code;
    }
    z.next_in = plain;
    z.avail_in = (uInt)size;
    z.next_out = slot->packed;
    z.avail_out = (uInt)run->capacity;
    code = deflate(&z, s->one_stream && !last ? Z_FULL_FLUSH : Z_FINISH);
    bool complete = z.avail_in == 0 && (code == Z_STREAM_END || (code == Z_OK && z.avail_out > 0));
    slot->size = run->capacity - z.avail_out;
    deflateEnd(&z);
    return complete ? Z_OK : code == Z_MEM_ERROR ? code : Z_BUF_ERROR;
}

static void work(void *arg, size_t begin, size_t end, int worker) {
    strip_run *run = arg;
    const image_strips *s = run->strips;
    strip_worker *w = &run->workers[worker];
    for (size_t i = begin; i < end; i++) {
        strip_slot *slot = &run->slots[i];
        uint32_t index = run->first + (uint32_t)i;
        uint32_t y = index * s->rows;
        slot->rows = s->image->height - y < s->rows ? s->image->height - y : s->rows;
        size_t size = slot->rows * s->bytes_per_row;
        s->prepare(s, w->plain, y, slot->rows, w->row, w->scratch);
        if (s->one_stream) {
            slot->adler = adler32(adler32(0, NULL, 0), w->plain, (uInt)size);
        }
        slot->code = deflate_strip(run, slot, w->plain, size, index + 1 == run->count);
    }
}

static brace_status emit_batch(const strip_run *run, uint32_t batch, uLong *adler, brace_error *error) {
    const image_strips *s = run->strips;
    for (uint32_t i = 0; i < batch; i++) {
        strip_slot *slot = &run->slots[i];
        if (slot->code == Z_MEM_ERROR) {
            return core_fail_memory(error, (size_t)1 << 18, "compression");
        }
        if (slot->code != Z_OK) {
            return core_fail(error, BRACE_ERROR_IO, "%s: zlib failed to compress the picture (%d)", s->name,
                             slot->code);
        }
        unsigned char *data = slot->packed;
        size_t size = slot->size;
        if (s->one_stream) {
            *adler = adler32_combine(*adler, slot->adler, (z_off_t)(slot->rows * s->bytes_per_row));
            if (run->first + i + 1 == run->count) { /* RFC 1950: the stream's check value; `capacity` has room */
                for (int k = 3; k >= 0; k--) {
                    data[size++] = (unsigned char)(*adler >> (8 * k));
                }
            }
        }
        brace_status status = s->emit(s->arg, run->first + i, data, size, error);
        if (status != BRACE_OK) {
            return status;
        }
    }
    return BRACE_OK;
}

static void run_free(strip_run *run, int threads, uint32_t slots) {
    for (uint32_t i = 0; run->slots != NULL && i < slots; i++) {
        core_free(run->slots[i].packed);
    }
    for (int i = 0; run->workers != NULL && i < threads; i++) {
        core_free(run->workers[i].plain);
        core_free(run->workers[i].row);
        core_free(run->workers[i].scratch);
    }
    core_free(run->slots);
    core_free(run->workers);
}

/* The low bytes of deep photographs are noise, in which a search for repeated strings finds chance matches that cost
 * more than they save: on such rows Z_RLE (Huffman codes and runs of one byte) is four times as fast as the usual
 * search at level 4, and 3 % smaller. Flat synthetic pictures come out larger; who wants those small asks for 6 or
 * more. */
int image_strips_strategy(brace_sample sample, int compression) {
    return sample != BRACE_SAMPLE_U8 && compression <= 5 ? Z_RLE : Z_DEFAULT_STRATEGY;
}

brace_status image_strips_run(const image_strips *s, const brace_job *job, brace_error *error) {
    core_pool *pool = NULL;
    brace_status status = core_pool_create(&pool, job, error);
    if (status != BRACE_OK) {
        return status;
    }
    int threads = core_pool_threads(pool);
    strip_run run = {.strips = s, .count = (s->image->height - 1) / s->rows + 1};
    uint32_t slots = (uint32_t)threads * 2 < run.count ? (uint32_t)threads * 2 : run.count;
    size_t plain = s->rows * s->bytes_per_row;
    /* deflateBound's terms for settings that are not zlib's own, which compressBound is about: here noise grows by more.
     * And the flush marker and check value. */
    run.capacity = plain + plain / 8 + plain / 64 + 128;
    run.slots = core_calloc(slots, sizeof *run.slots);
    run.workers = core_calloc((size_t)threads, sizeof *run.workers);
    bool complete = run.slots != NULL && run.workers != NULL;
    for (uint32_t i = 0; complete && i < slots; i++) {
        run.slots[i].packed = core_alloc(run.capacity, 1);
        complete = run.slots[i].packed != NULL;
    }
    for (int i = 0; complete && i < threads; i++) {
        strip_worker *w = &run.workers[i];
        w->plain = core_alloc(plain, 1);
        w->row = core_alloc(2, image_row_bytes(s->layout, s->image->width) + 64);
        w->scratch = core_alloc((size_t)s->image->width * 4, sizeof *w->scratch);
        complete = w->plain != NULL && w->row != NULL && w->scratch != NULL;
    }
    if (!complete) {
        status = core_fail_memory(error, plain + run.capacity, "compression");
    }
    uLong adler = adler32(0, NULL, 0);
    for (uint32_t first = 0; status == BRACE_OK && first < run.count; first += slots) {
        uint32_t batch = run.count - first < slots ? run.count - first : slots;
        run.first = first;
        core_parallel(pool, batch, 1, work, &run);
        status = emit_batch(&run, batch, &adler, error);
        if (status == BRACE_OK) {
            status = core_check_cancel(job, error);
        }
    }
    run_free(&run, threads, slots);
    core_pool_destroy(pool);
    return status;
}
