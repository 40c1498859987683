/* SPDX-License-Identifier: Apache-2.0 */
/*
 * leaks.c: what LeakSanitizer needs to tell libgphoto2's leaks from ours. The
 * library unloads its drivers, after which nobody can say whose an address was: so
 * here they stay. Those of version 2.5.30 lose the list of USB devices, and what a
 * connection that failed while it was opened had allocated.
 */
int dlclose(void *handle);
const char *__lsan_default_suppressions(void);
const char *__asan_default_options(void);

int dlclose(void *handle) {
    (void)handle;
    return 0;
}

const char *__lsan_default_suppressions(void) {
    return "leak:libusb-1.0.so\nleak:/usb1.so\nleak:/ptp2.so\n";
}

const char *__asan_default_options(void) {
    return "fast_unwind_on_malloc=0"; /* the driver stands further up in the stack */
}
