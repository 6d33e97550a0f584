/* Stands in front of Debian's fakenect, under the name of the library, for what that cannot do.

   It knows only raw depth and ends the process that asks for another mode; here it plays registered depth, which it hands
   over as it finds it. It has one sensor, and here there are two: the next image of the dump is that of the sensor whose
   events are processed. And no sensor of it ever fails: KINECT_FAULT makes one fail as libfreenect 0.5.3 does, by what
   that returns and logs. */

#define _GNU_SOURCE
#include <dlfcn.h>
#include <libfreenect.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

struct kinect {
    freenect_depth_cb depth;
    freenect_video_cb video;
};

static struct kinect kinects[2];
static struct kinect *of_context[8]; /* the sensor that was opened in each context, which is a pointer into this list */
static freenect_log_cb hear;
static int contexts, opened, played;

static int fault(const char *name) {
    const char *wanted = getenv("KINECT_FAULT");
    return wanted && !strcmp(wanted, name);
}

static int complain(freenect_context *context, const char *message) {
    hear(context, FREENECT_LOG_ERROR, message);
    return -1;
}

freenect_frame_mode freenect_find_depth_mode(freenect_resolution resolution, freenect_depth_format format) {
    freenect_frame_mode (*find)(freenect_resolution, freenect_depth_format) = dlsym(RTLD_NEXT, "freenect_find_depth_mode");
    freenect_frame_mode mode = find(resolution, FREENECT_DEPTH_11BIT);
    if (format != FREENECT_DEPTH_REGISTERED)
        abort();
    mode.depth_format = format;
    return mode;
}

int freenect_set_depth_mode(freenect_device *device, const freenect_frame_mode mode) {
    return mode.depth_format == FREENECT_DEPTH_REGISTERED && mode.bytes == 640 * 480 * 2 ? 0 : -1;
}

int freenect_set_video_mode(freenect_device *device, const freenect_frame_mode mode) {
    return mode.video_format == FREENECT_VIDEO_RGB && mode.bytes == 640 * 480 * 3 ? 0 : -1;
}

void freenect_set_log_callback(freenect_context *context, freenect_log_cb callback) { hear = callback; }

int freenect_init(freenect_context **context, freenect_usb_context *usb) {
    *context = (freenect_context *)&of_context[contexts++ % 8];
    return 0;
}

int freenect_num_devices(freenect_context *context) { return fault("absent") ? 0 : 2; }

int freenect_open_device(freenect_context *context, freenect_device **device, int index) {
    struct kinect *kinect = &kinects[index];
    if (fault("forbidden"))
        return complain(context, "Could not open camera: -3\n");
    if (fault("busy") || kinect->depth)
        return complain(context, "Failed to claim camera interface: LIBUSB_ERROR_BUSY\n");
    if (fault("broken"))
        return complain(context, "freenect_camera_init(): Failed to fetch zero plane info for device\n");
    opened++;
    *(struct kinect **)context = kinect;
    *device = (freenect_device *)kinect;
    return 0;
}

void freenect_set_depth_callback(freenect_device *device, freenect_depth_cb callback) {
    ((struct kinect *)device)->depth = callback;
}

void freenect_set_video_callback(freenect_device *device, freenect_video_cb callback) {
    ((struct kinect *)device)->video = callback;
}

int freenect_process_events_timeout(freenect_context *context, struct timeval *timeout) {
    int (*process)(freenect_context *) = dlsym(RTLD_NEXT, "freenect_process_events");
    void (*on_depth)(freenect_device *, freenect_depth_cb) = dlsym(RTLD_NEXT, "freenect_set_depth_callback");
    void (*on_video)(freenect_device *, freenect_video_cb) = dlsym(RTLD_NEXT, "freenect_set_video_callback");
    struct kinect *kinect = *(struct kinect **)context;
    int over = played++ >= 8;
    if (fault("unplugged") && over)
        return complain(context, "USB device disappeared, cancelling stream 80 :(\n");
    if (fault("still") && over)
        return usleep(timeout->tv_sec * 1000000 + timeout->tv_usec);
    on_depth(NULL, kinect->depth);
    on_video(NULL, kinect->video);
    return process(context);
}

int freenect_close_device(freenect_device *device) {
    opened--;
    ((struct kinect *)device)->depth = NULL;
    return 0;
}

int freenect_shutdown(freenect_context *context) {
    int (*shut_down)(freenect_context *) = dlsym(RTLD_NEXT, "freenect_shutdown");
    fprintf(stderr, "shut down with %d open\n", opened);
    return shut_down(context);
}
