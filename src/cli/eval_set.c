/* SPDX-License-Identifier: Apache-2.0 */
/* eval_set.c: the samples that methods are compared on, and means over groups of them. */
#include "cli/eval.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* ---- samples ---- */

/* What follows the number in a sample's name: 000012_web2. */
static const char *category_of(const char *name) {
    const char *slash = strrchr(name, '/'), *base = slash != NULL ? slash + 1 : name;
    const char *line = strchr(base, '_');
    return line != NULL && line != base && strspn(base, "0123456789") == (size_t)(line - base) ? line + 1 : "other";
}

/* Samples without meta.json are known by their folder's name: led_wall_2, flicker_free; but not by a number. */
static const char *family_by_name(const char *name) {
    const char *slash = strrchr(name, '/'), *base = slash != NULL ? slash + 1 : name;
    return base[0] >= '0' && base[0] <= '9' ? "unknown" : base;
}

static void read_meta(eval_sample *s, const json_t *meta) {
    const json_t *display = json_object_get(meta, "display"), *family = json_object_get(meta, "family");
    if (json_is_object(display)) {
        family = json_object_get(display, "family");
    }
    const char *name = meta == NULL ? family_by_name(s->name) : "unknown";
    s->steady = json_is_true(json_object_get(meta, "flicker_free")) || strncmp(name, "flicker_free", 12) == 0;
    snprintf(s->family, sizeof s->family, "%s", json_is_string(family) ? json_string_value(family) : name);
    snprintf(s->category, sizeof s->category, "%s", category_of(s->name));
}

brace_status eval_set_read(eval_set *out, const char *folder, size_t most, const brace_job *job, brace_error *error) {
    dataset_list list;
    brace_status status = dataset_list_read(&list, folder, error);
    if (status != BRACE_OK) {
        return status;
    }
    size_t first = 0, count = list.count;
    for (size_t i = list.count; i-- > 0;) { /* sorted: the split lies together */
        first = strncmp(list.items[i].name, "test/", 5) == 0 ? i : first;
    }
    size_t tests = 0;
    for (size_t i = 0; i < list.count; i++) {
        tests += strncmp(list.items[i].name, "test/", 5) == 0;
    }
    first = tests > 0 ? first : 0;
    count = tests > 0 ? tests : count;
    const size_t taken = most > 0 && most < count ? most : count;
    out->folder = folder;
    out->items = core_calloc(taken, sizeof *out->items);
    if (out->items == NULL) {
        status = core_fail_memory(error, taken * sizeof *out->items, "a list of samples");
    }
    for (size_t i = 0; i < taken && status == BRACE_OK; i++) {
        dataset_sample *from = &list.items[first + i * count / taken];
        eval_sample *s = &out->items[i];
        json_t *meta = NULL;
        core_progress(job, "looking", i, taken);
        s->folder = from->folder, s->name = from->name;
        from->folder = from->name = NULL; /* taken over */
        out->count = i + 1;
        s->reference_psnr = NAN;
        for (size_t m = 0; m < EVAL_METHODS; m++) {
            for (metric k = 0; k < METRICS; k++) {
                s->result[m].measured.value[k] = NAN;
            }
        }
        char *path = dataset_path(s->folder, "meta.json");
        status = path != NULL ? dataset_json_load(&meta, path, DATASET_META_LIMIT, error)
                              : core_fail_memory(error, 256, "a name");
        read_meta(s, meta);
        json_decref(meta);
        core_free(path);
    }
    dataset_list_free(&list);
    return status;
}

void eval_set_free(eval_set *set) {
    for (size_t i = 0; i < set->count; i++) {
        eval_sample *s = &set->items[i];
        core_free(s->folder);
        core_free(s->name);
        for (size_t k = 0; k < EVAL_METHODS + 2; k++) {
            brace_image_destroy(s->picture[k]);
        }
    }
    core_free(set->items);
    for (size_t m = 0; m < set->methods; m++) {
        free(set->method[m].model);
    }
    *set = (eval_set){0};
}

/* ---- methods ---- */

/* "runs/mine/weights.safetensors": mine; "models/brace-s.safetensors": brace-s. */
static void label_of(char *label, size_t size, const char *model) {
    const char *end = model + strlen(model), *base = cli_basename(model);
    if (strcmp(base, "weights.safetensors") == 0 && base > model) {
        end = base - 1;
        base = end;
        while (base > model && base[-1] != '/') {
            base--;
        }
    } else {
        const char *dot = strrchr(base, '.');
        end = dot != NULL && dot > base ? dot : end;
    }
    snprintf(label, size, "%.*s", (int)(end - base), base);
}

static bool add_method(eval_set *set, const char *word, const char *command) {
    eval_method *m = &set->method[set->methods];
    const char *equals = strchr(word, '='), *model = equals != NULL ? equals + 1 : word;
    *m = (eval_method){.method = BRACE_METHOD_NETWORK};
    if (strcmp(model, "reference") == 0 || strcmp(model, "merge") == 0) {
        m->method = model[0] == 'r' ? BRACE_METHOD_REFERENCE : BRACE_METHOD_MERGE;
    } else {
        m->model = strdup(model);
        if (m->model == NULL) {
            cli_error(command, "out of memory");
            return false;
        }
    }
    if (equals != NULL) {
        snprintf(m->label, sizeof m->label, "%.*s", (int)(equals - word), word);
    } else {
        label_of(m->label, sizeof m->label, model);
    }
    set->methods++;
    for (size_t i = 0; i + 1 < set->methods; i++) {
        if (strcmp(set->method[i].label, m->label) == 0) {
            cli_wrong_usage(command, "--method has '%s' twice; write LABEL=%s", m->label, model);
            return false;
        }
    }
    return true;
}

int eval_methods_parse(eval_set *set, const char *text, const char *command) {
    char *copy = strdup(text), *rest = copy, *word;
    int code = -1;
    if (copy == NULL) {
        cli_error(command, "out of memory");
        return CLI_FAILED;
    }
    while (code < 0 && (word = strsep(&rest, ",")) != NULL) {
        const char *equals = strchr(word, '=');
        if (word[0] == '\0' || word[0] == '=' || (equals != NULL && equals[1] == '\0')) {
            code = cli_wrong_usage(command, "--method has an empty name in '%s'", text);
        } else if (set->methods == EVAL_METHODS) {
            code = cli_wrong_usage(command, "--method takes at most %d", EVAL_METHODS);
        } else if (!add_method(set, word, command)) {
            code = CLI_USAGE;
        }
    }
    free(copy);
    return code;
}

/* ---- what is shown ---- */

/* How many samples of the same family come before one. */
static size_t rank_of(const eval_set *set, size_t index) {
    size_t rank = 0;
    for (size_t i = 0; i < index; i++) {
        rank += strcmp(set->items[i].family, set->items[index].family) == 0;
    }
    return rank;
}

void eval_choose(eval_set *set, size_t most) {
    size_t *rank = core_alloc(set->count + 1, sizeof *rank), chosen = 0;
    for (size_t i = 0; i < set->count && rank != NULL; i++) {
        rank[i] = rank_of(set, i);
    }
    for (size_t round = 0; round < set->count && rank != NULL; round++) {
        for (size_t i = 0; i < set->count && chosen < most; i++) {
            if (rank[i] == round) {
                set->items[i].shown = true;
                chosen++;
            }
        }
    }
    core_free(rank);
}

bool eval_choose_named(eval_set *set, const char *names, const char *command) {
    char *copy = strdup(names), *rest = copy, *word;
    bool good = copy != NULL;
    while (good && (word = strsep(&rest, ",")) != NULL) {
        bool found = false;
        for (size_t i = 0; i < set->count; i++) {
            if (word[0] != '\0' && strstr(set->items[i].name, word) != NULL) {
                set->items[i].shown = found = true;
            }
        }
        if (!found) {
            cli_error(command, "--scenes: no sample has '%s' in its name", word);
            good = false;
        }
    }
    free(copy);
    return good;
}

bool eval_has_picture(const eval_set *set, size_t index) {
    return index == 0 || index > set->methods || set->method[index - 1].method != BRACE_METHOD_REFERENCE;
}

/* ---- groups ---- */

static bool belongs(const eval_sample *s, const eval_group *g) {
    switch (g->kind) {
    case EVAL_BANDED:
        return s->done && !s->steady;
    case EVAL_STEADY:
        return s->done && s->steady;
    case EVAL_FAMILY:
        return s->done && !s->steady && strcmp(s->family, g->name) == 0;
    case EVAL_CATEGORY:
        return s->done && !s->steady && strcmp(s->category, g->name) == 0;
    }
    return false;
}

/* Puts a group in its place by kind and name, unless it is there; false: no room. */
static bool insert(eval_group *list, size_t *count, size_t room, eval_group g) {
    size_t at = *count;
    for (size_t i = 0; i < *count; i++) {
        if (list[i].kind == g.kind && (g.name == NULL || strcmp(list[i].name, g.name) == 0)) {
            list[i].count++;
            return true;
        }
    }
    if (*count == room) {
        return false;
    }
    for (; at > 0 && (list[at - 1].kind > g.kind ||
                      (list[at - 1].kind == g.kind && g.name != NULL && strcmp(list[at - 1].name, g.name) > 0));
         at--) {
        list[at] = list[at - 1];
    }
    list[at] = g;
    ++*count;
    return true;
}

size_t eval_groups(const eval_set *set, eval_group *out, size_t room) {
    size_t count = 0;
    for (size_t i = 0; i < set->count; i++) {
        const eval_sample *s = &set->items[i];
        if (!s->done) {
            continue;
        }
        insert(out, &count, room, (eval_group){s->steady ? EVAL_STEADY : EVAL_BANDED, NULL, 1});
        if (!s->steady) {
            insert(out, &count, room, (eval_group){EVAL_FAMILY, s->family, 1});
            insert(out, &count, room, (eval_group){EVAL_CATEGORY, s->category, 1});
        }
    }
    return count;
}

const char *eval_group_text(char *text, size_t size, const eval_group *g) {
    static const char *const kinds[] = {"banded", "flicker-free", "family", "category"};
    snprintf(text, size, "%s%s%s (%zu)", kinds[g->kind], g->name != NULL ? " " : "", g->name != NULL ? g->name : "",
             g->count);
    return text;
}

eval_mean eval_mean_of(const eval_set *set, const eval_group *g, size_t method) {
    eval_mean out = {.worse = 0};
    size_t counts[METRICS] = {0};
    double squares[METRICS] = {0};
    brace_sfc *parts = core_alloc(set->count + 1, sizeof *parts);
    size_t measured = 0;
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < set->count; i++) {
            const eval_sample *s = &set->items[i];
            const eval_result *r = &s->result[method];
            if (!belongs(s, g) || isnan(r->measured.value[PSNR])) {
                continue;
            }
            for (metric m = 0; m < METRICS; m++) {
                const double v = m == PSNR ? fmin(r->measured.value[m], 100) : r->measured.value[m];
                if (!isnan(v) && pass == 0) {
                    out.mean[m] += v;
                    counts[m]++;
                } else if (!isnan(v)) {
                    squares[m] += (v - out.mean[m]) * (v - out.mean[m]);
                }
            }
            if (pass == 0) {
                out.count++;
                out.seconds += r->seconds;
                out.worse += fmin(r->measured.value[PSNR], 100) < fmin(s->reference_psnr, 100) - 1e-9;
                if (!isnan(r->measured.value[SFC]) && parts != NULL) {
                    parts[measured++] = r->measured.sfc;
                }
            }
        }
        for (metric m = 0; m < METRICS; m++) {
            const double n = (double)counts[m];
            if (pass == 0) {
                out.mean[m] = counts[m] > 0 ? out.mean[m] / n : NAN;
            } else {
                out.deviation[m] = counts[m] > 0 ? sqrt(squares[m] / n) : NAN;
            }
        }
    }
    out.seconds = out.count > 0 ? out.seconds / (double)out.count : NAN;
    metrics_sfc_summary(out.parts, out.parts_deviation, parts, measured);
    core_free(parts);
    return out;
}
