/* SPDX-License-Identifier: Apache-2.0 */
/*
 * brace.h: all of BRACE's public interface. Read in this order:
 *   status.h   errors            job.h      threads, progress, cancelling
 *   frame.h    one RAW file      bracket.h  several exposures of one screen
 *   image.h    pictures          develop.h  RAW to picture
 *   restore.h  a bracket in, one clean frame out
 *   banding.h  how strongly a frame bands, at what frequency, and how well that was removed
 *   simulate.h a picture on a display in, a bracket of it out
 *   metrics.h  how far a picture is from its ground truth
 */
#ifndef BRACE_BRACE_H
#define BRACE_BRACE_H

#include "banding.h"
#include "bracket.h"
#include "develop.h"
#include "frame.h"
#include "image.h"
#include "job.h"
#include "metrics.h"
#include "restore.h"
#include "simulate.h"
#include "status.h"
#include "version.h"

#endif
