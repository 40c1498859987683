/* SPDX-License-Identifier: Apache-2.0 */
/*
 * pth.h: the tensors of a PyTorch file (.pth, .pt), mapped and not read, where they
 * lie in one piece.
 *
 * Both formats of torch.save: since 1.6 a zip archive of one pickle and a file a
 * storage, before that pickles followed by the storages. The tensors of nested dicts
 * and lists are named by their keys, joined with dots: "state_dict.conv1.weight". Other
 * values in the file are passed over. Nothing is executed (pickle.h).
 *
 * Thread safety: an open file may be read from several threads.
 */
#ifndef NN_PTH_H
#define NN_PTH_H

#include "core/safetensors.h"

typedef struct nn_pth nn_pth;

/* Maps a file; it must not shrink while it is open. Every tensor is checked to lie in the file. */
brace_status nn_pth_open(nn_pth **out, const char *path, brace_error *error);
/* The same of bytes in memory, which must stay as long as `out`. */
brace_status nn_pth_parse(nn_pth **out, const void *data, size_t size, const char *name, brace_error *error);
void nn_pth_close(nn_pth *file); /* NULL is allowed */

/* core_tensor.data may not be aligned for its type. */
size_t nn_pth_count(const nn_pth *file);
const core_tensor *nn_pth_at(const nn_pth *file, size_t index);       /* in the order of the file */
const core_tensor *nn_pth_find(const nn_pth *file, const char *name); /* NULL: none */

#endif
