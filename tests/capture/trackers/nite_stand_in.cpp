// A stand-in for NiTE2, which is proprietary and not to be had: a library with the C functions that Puppetline calls.
// It finds nobody: people are whom a test puts in, through the functions stand_in_*. Nothing here says that NiTE2
// itself was run. What is real is the sensor's depth stream, which it opens through the real OpenNI2 library, and by
// which frames come and carry their times.

#include <OniCAPI.h>

#include <atomic>
#include <cstdint>
#include <mutex>
#include <set>
#include <vector>

namespace {

struct Point { float x, y, z; };
struct Quaternion { float x, y, z, w; };
struct Joint { int type; Point position; float confidence; Quaternion orientation; float orientation_confidence; };
struct Skeleton { Joint joints[15]; int state, internal_state; };
struct Pose { int type, state; };
struct User { short id; Point box[2], center; int state; Skeleton skeleton; Pose poses[2]; };
struct Map { short* pixels; int width, height, stride; };
struct Frame {
    int count;
    User* users;
    Map map;
    OniFrame* depth;
    uint64_t timestamp;
    int index;
    float floor_confidence;
    Point floor[2];
};
struct Callbacks { void (*ready)(void*); };
struct Device { void* playback; OniDeviceHandle handle; };  // openni::Device, as far as it is asked for

struct Tracker {
    OniStreamHandle stream = nullptr;
    OniCallbackHandle handle = nullptr;
    std::set<short> tracked;
    std::mutex lock;  // of what follows
    void (*ready)(void*) = nullptr;
    void* cookie = nullptr;
};

enum Refusal { STARTING = 1, TRACKING = 2, READING = 4, ANSWERING = 8 };

std::mutex lock;  // of what follows
std::vector<User> people;
std::atomic<int> refuses{0}, trackers{0}, frames{0};

void arrived(OniStreamHandle, void* cookie) {
    auto& tracker = *static_cast<Tracker*>(cookie);
    std::lock_guard<std::mutex> guard(tracker.lock);
    if (tracker.ready != nullptr && !(refuses & ANSWERING)) tracker.ready(tracker.cookie);
}

}  // namespace

extern "C" {

// State that a test sets.

void stand_in_refuse(int what) { refuses = what; }

void stand_in_clear() {
    std::lock_guard<std::mutex> guard(lock);
    people.clear();
}

// A user, with 15 joints of x, y, z (mm) and confidence; the skeleton's state shows once it is asked to be tracked.
void stand_in_show(short id, int state, int skeleton, const float* joints) {
    std::lock_guard<std::mutex> guard(lock);
    User user{};
    user.id = id;
    user.state = state;
    user.skeleton.state = skeleton;
    for (int k = 0; k < 15; k++, joints += 4)
        user.skeleton.joints[k] = {k, {joints[0], joints[1], joints[2]}, joints[3], {0, 0, 0, 1}, 0};
    people.push_back(user);
}

int stand_in_trackers() { return trackers; }
int stand_in_frames() { return frames; }

// Functions that NiTE2 exports.

int niteInitialize() { return refuses & STARTING ? 1 : 0; }

void niteShutdown() {}

int niteInitializeUserTracker(Tracker**) { return 1; }

int niteInitializeUserTrackerByDevice(Device* device, Tracker** handle) {
    if (refuses & TRACKING) return 1;
    auto* tracker = new Tracker;
    if (oniDeviceCreateStream(device->handle, ONI_SENSOR_DEPTH, &tracker->stream) != ONI_STATUS_OK ||
        oniStreamRegisterNewFrameCallback(tracker->stream, arrived, tracker, &tracker->handle) != ONI_STATUS_OK ||
        oniStreamStart(tracker->stream) != ONI_STATUS_OK) {
        delete tracker;
        return 1;
    }
    trackers++;
    *handle = tracker;
    return 0;
}

int niteShutdownUserTracker(Tracker* tracker) {
    oniStreamUnregisterNewFrameCallback(tracker->stream, tracker->handle);
    oniStreamStop(tracker->stream);
    oniStreamDestroy(tracker->stream);
    delete tracker;
    trackers--;
    return 0;
}

int niteRegisterUserTrackerCallbacks(Tracker* tracker, Callbacks* callbacks, void* cookie) {
    std::lock_guard<std::mutex> guard(tracker->lock);
    tracker->ready = callbacks->ready;
    tracker->cookie = cookie;
    return 0;
}

void niteUnregisterUserTrackerCallbacks(Tracker* tracker, Callbacks*) {
    std::lock_guard<std::mutex> guard(tracker->lock);
    tracker->ready = nullptr;
}

int niteStartSkeletonTracking(Tracker* tracker, short id) {
    tracker->tracked.insert(id);
    return 0;
}

int niteReadUserTrackerFrame(Tracker* tracker, Frame** result) {
    OniFrame* depth = nullptr;
    if ((refuses & READING) || oniStreamReadFrame(tracker->stream, &depth) != ONI_STATUS_OK) return 1;
    std::lock_guard<std::mutex> guard(lock);
    auto* frame = new Frame{};
    frame->count = int(people.size());
    frame->users = new User[people.size()];
    for (size_t k = 0; k < people.size(); k++) {
        frame->users[k] = people[k];
        if (people[k].state & 4) tracker->tracked.erase(people[k].id);
        if (tracker->tracked.count(people[k].id) == 0) frame->users[k].skeleton.state = 0;
    }
    frame->depth = depth;
    frame->timestamp = depth->timestamp;
    frame->index = depth->frameIndex;
    frames++;
    *result = frame;
    return 0;
}

int niteUserTrackerFrameRelease(Tracker*, Frame* frame) {
    oniFrameRelease(frame->depth);
    delete[] frame->users;
    delete frame;
    frames--;
    return 0;
}

// Functions that the bindings require but nothing calls.
#define UNUSED(name) int name() { return 1; }
UNUSED(niteGetVersion)
UNUSED(niteStopSkeletonTracking)
UNUSED(niteIsSkeletonTracking)
UNUSED(niteSetSkeletonSmoothing)
UNUSED(niteGetSkeletonSmoothing)
UNUSED(niteStartPoseDetection)
UNUSED(niteStopPoseDetection)
UNUSED(niteStopAllPoseDetection)
UNUSED(niteUserTrackerFrameAddRef)
UNUSED(niteInitializeHandTracker)
UNUSED(niteInitializeHandTrackerByDevice)
UNUSED(niteShutdownHandTracker)
UNUSED(niteStartHandTracking)
UNUSED(niteStopHandTracking)
UNUSED(niteStopAllHandTracking)
UNUSED(niteSetHandSmoothingFactor)
UNUSED(niteGetHandSmoothingFactor)
UNUSED(niteRegisterHandTrackerCallbacks)
UNUSED(niteUnregisterHandTrackerCallbacks)
UNUSED(niteReadHandTrackerFrame)
UNUSED(niteHandTrackerFrameAddRef)
UNUSED(niteHandTrackerFrameRelease)
UNUSED(niteStartGestureDetection)
UNUSED(niteStopGestureDetection)
UNUSED(niteStopAllGestureDetection)
UNUSED(niteConvertJointCoordinatesToDepth)
UNUSED(niteConvertDepthCoordinatesToJoint)
UNUSED(niteConvertHandCoordinatesToDepth)
UNUSED(niteConvertDepthCoordinatesToHand)

}  // extern "C"
