// A driver for the real OpenNI2 library: sensors that show what a test writes into mapped files.
//
// The folder PUPPETLINE_VIRTUAL_SENSORS holds a file for each sensor, "0", "1", ...: a Shared, 640 x 480 depths
// (uint16, mm) and as many colours (RGB). As sensors do, they start mirrored, at half the resolution, not registered
// (depth is then SHIFT pixels too far right) and not synchronised (colour is then LATE us after depth).

#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <mutex>
#include <string>
#include <sys/mman.h>
#include <thread>
#include <unistd.h>
#include <vector>

#define TRUE 1
#define FALSE 0
#define XN_NEW(type, ...) new type(__VA_ARGS__)
#define XN_DELETE(pointer) delete (pointer)
#include <Driver/OniDriverAPI.h>

using namespace oni::driver;

namespace {

constexpr int WIDTH = 640, HEIGHT = 480, SENSORS = 2, SHIFT = 8;
constexpr uint64_t LATE = 5000;
constexpr float FIELD_OF_VIEW = 1.0f;
constexpr auto A_WHILE = std::chrono::microseconds(500);

struct Shared {
    std::atomic<uint32_t> plugged;    // written by the test
    std::atomic<uint32_t> listed;     // written here: whether the library has been told so
    std::atomic<uint32_t> shown;      // written by the test: how many pictures
    std::atomic<uint32_t> given;      // written here: the last picture that streams gave
    std::atomic<uint32_t> streaming;  // written here: how many streams run
    std::atomic<uint32_t> refuses;    // written by the test: 1 opening, 2 registration, 4 synchronisation, 8 mirror off
    std::atomic<uint64_t> time;       // written by the test: microseconds, of the picture
};

constexpr size_t DEPTHS = size_t(WIDTH) * HEIGHT * 2, SIZE = sizeof(Shared) + DEPTHS + size_t(WIDTH) * HEIGHT * 3;

enum Refusal { OPENING = 1, REGISTRATION = 2, SYNCHRONISATION = 4, MIRROR_OFF = 8 };

template <class T> OniStatus give(const T& value, void* data, int* size) {
    if (*size < int(sizeof(T))) return ONI_STATUS_BAD_PARAMETER;
    std::memcpy(data, &value, sizeof(T));
    *size = sizeof(T);
    return ONI_STATUS_OK;
}

OniVideoMode mode_of(OniSensorType sensor, int width, int height) {
    auto format = sensor == ONI_SENSOR_DEPTH ? ONI_PIXEL_FORMAT_DEPTH_1_MM : ONI_PIXEL_FORMAT_RGB888;
    return {format, width, height, 30};
}

struct Sensor {
    Shared* shared = nullptr;
    OniDeviceInfo info{};
    const uint16_t* depth() const { return reinterpret_cast<const uint16_t*>(shared + 1); }
    const uint8_t* color() const { return reinterpret_cast<const uint8_t*>(shared + 1) + DEPTHS; }
    bool refuses(Refusal what) const { return shared->refuses & what; }
};

class Stream : public StreamBase {
public:
    Stream(const Sensor& sensor, OniSensorType type, const std::atomic<bool>& registered,
           std::atomic<bool>& synchronised)
        : sensor_(sensor), type_(type), mode_(mode_of(type, WIDTH / 2, HEIGHT / 2)), registered_(registered),
          synchronised_(synchronised) {}
    ~Stream() override { stop(); }

    OniStatus start() override {
        if (!running_) sensor_.shared->streaming++;
        running_ = true;
        return ONI_STATUS_OK;
    }

    void stop() override {
        if (running_) sensor_.shared->streaming--;
        running_ = false;
    }

    OniStatus getProperty(int id, void* data, int* size) override {
        switch (id) {
        case ONI_STREAM_PROPERTY_VIDEO_MODE: return give(mode_, data, size);
        case ONI_STREAM_PROPERTY_MIRRORING: return give(OniBool(mirrored_), data, size);
        case ONI_STREAM_PROPERTY_CROPPING: return give(OniCropping{FALSE, 0, 0, 0, 0}, data, size);
        case ONI_STREAM_PROPERTY_STRIDE: return give(mode_.resolutionX * bytes(), data, size);
        case ONI_STREAM_PROPERTY_HORIZONTAL_FOV: return give(FIELD_OF_VIEW, data, size);
        case ONI_STREAM_PROPERTY_VERTICAL_FOV:
            return give(2 * std::atan(std::tan(FIELD_OF_VIEW / 2) * HEIGHT / WIDTH), data, size);
        case ONI_STREAM_PROPERTY_MAX_VALUE: return give(10000, data, size);
        default: return ONI_STATUS_NOT_IMPLEMENTED;
        }
    }

    OniStatus setProperty(int id, const void* data, int) override {
        switch (id) {
        case ONI_STREAM_PROPERTY_VIDEO_MODE: mode_ = *static_cast<const OniVideoMode*>(data); return ONI_STATUS_OK;
        case ONI_STREAM_PROPERTY_MIRRORING:
            if (sensor_.refuses(MIRROR_OFF)) return ONI_STATUS_NOT_SUPPORTED;
            mirrored_ = *static_cast<const OniBool*>(data);
            return ONI_STATUS_OK;
        default: return ONI_STATUS_NOT_IMPLEMENTED;
        }
    }

    OniBool isPropertySupported(int id) override {
        return id == ONI_STREAM_PROPERTY_VIDEO_MODE || id == ONI_STREAM_PROPERTY_MIRRORING ||
               id == ONI_STREAM_PROPERTY_CROPPING || id == ONI_STREAM_PROPERTY_STRIDE ||
               id == ONI_STREAM_PROPERTY_HORIZONTAL_FOV || id == ONI_STREAM_PROPERTY_VERTICAL_FOV ||
               id == ONI_STREAM_PROPERTY_MAX_VALUE;
    }

    void notifyAllProperties() override {  // what a recorder writes down
        raise(ONI_STREAM_PROPERTY_VIDEO_MODE, mode_);
        raise(ONI_STREAM_PROPERTY_MIRRORING, OniBool(mirrored_));
        raise(ONI_STREAM_PROPERTY_HORIZONTAL_FOV, FIELD_OF_VIEW);
    }

    bool running() const { return running_; }

    std::atomic<bool>* synchronise() {
        if (sensor_.refuses(SYNCHRONISATION)) return nullptr;
        synchronised_ = true;
        return &synchronised_;
    }

    void raise_picture(int index) {
        if (!running_) return;
        OniFrame* frame = getServices().acquireFrame();
        if (frame == nullptr) return;
        frame->sensorType = type_;
        frame->frameIndex = index;
        frame->timestamp = sensor_.shared->time + (type_ == ONI_SENSOR_COLOR && !synchronised_ ? LATE : 0);
        frame->videoMode = mode_;
        frame->width = mode_.resolutionX;
        frame->height = mode_.resolutionY;
        frame->croppingEnabled = FALSE;
        frame->cropOriginX = frame->cropOriginY = 0;
        frame->stride = mode_.resolutionX * bytes();
        frame->dataSize = frame->stride * frame->height;
        fill(static_cast<uint8_t*>(frame->data));
        raiseNewFrame(frame);
        getServices().releaseFrame(frame);
    }

private:
    int bytes() const { return type_ == ONI_SENSOR_DEPTH ? 2 : 3; }

    template <class T> void raise(int id, const T& value) { raisePropertyChanged(id, &value, sizeof(T)); }

    void fill(uint8_t* to) const {
        const int step = WIDTH / mode_.resolutionX, shift = type_ == ONI_SENSOR_DEPTH && !registered_ ? SHIFT : 0;
        for (int y = 0; y < mode_.resolutionY; y++)
            for (int x = 0; x < mode_.resolutionX; x++, to += bytes()) {
                const int right = (mirrored_ ? mode_.resolutionX - 1 - x : x) * step - shift;
                const size_t pixel = size_t(y) * step * WIDTH + (right < 0 ? 0 : right);
                if (type_ == ONI_SENSOR_COLOR)
                    std::memcpy(to, sensor_.color() + pixel * 3, 3);
                else
                    std::memcpy(to, right < 0 ? "\0" : reinterpret_cast<const char*>(sensor_.depth() + pixel), 2);
            }
    }

    const Sensor& sensor_;
    const OniSensorType type_;
    OniVideoMode mode_;
    const std::atomic<bool>& registered_;
    std::atomic<bool>& synchronised_;
    std::atomic<bool> mirrored_{true}, running_{false};
};

class Device : public DeviceBase {
public:
    explicit Device(const Sensor& sensor) : sensor_(sensor) {
        for (int k = 0; k < 2; k++) {
            auto type = k == 0 ? ONI_SENSOR_DEPTH : ONI_SENSOR_COLOR;
            modes_[k][0] = mode_of(type, WIDTH / 2, HEIGHT / 2);
            modes_[k][1] = mode_of(type, WIDTH, HEIGHT);
            infos_[k] = {type, 2, modes_[k]};
        }
        thread_ = std::thread([this] { give_pictures(); });
    }

    ~Device() override {
        over_ = true;
        thread_.join();
    }

    OniStatus getSensorInfoList(OniSensorInfo** infos, int* count) override {
        *infos = infos_;
        *count = 2;
        return ONI_STATUS_OK;
    }

    StreamBase* createStream(OniSensorType type) override {
        std::lock_guard<std::mutex> guard(lock_);
        streams_.push_back(new Stream(sensor_, type, registered_, synchronised_));
        return streams_.back();
    }

    void destroyStream(StreamBase* stream) override {
        std::lock_guard<std::mutex> guard(lock_);
        for (size_t k = 0; k < streams_.size(); k++)
            if (streams_[k] == stream) streams_.erase(streams_.begin() + k--);
        delete stream;
    }

    OniStatus getProperty(int id, void* data, int* size) override {
        if (id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION)
            return give(registered_ ? ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR : ONI_IMAGE_REGISTRATION_OFF, data, size);
        if (id != ONI_DEVICE_PROPERTY_SERIAL_NUMBER) return ONI_STATUS_NOT_IMPLEMENTED;
        std::string serial = std::string("serial-") + (std::strrchr(sensor_.info.uri, '/') + 1);
        if (*size <= int(serial.size())) return ONI_STATUS_BAD_PARAMETER;
        std::strcpy(static_cast<char*>(data), serial.c_str());
        *size = int(serial.size()) + 1;
        return ONI_STATUS_OK;
    }

    OniStatus setProperty(int id, const void* data, int) override {
        if (id != ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION || sensor_.refuses(REGISTRATION))
            return ONI_STATUS_NOT_SUPPORTED;
        registered_ = *static_cast<const OniImageRegistrationMode*>(data) == ONI_IMAGE_REGISTRATION_DEPTH_TO_COLOR;
        return ONI_STATUS_OK;
    }

    OniBool isPropertySupported(int id) override {
        return id == ONI_DEVICE_PROPERTY_IMAGE_REGISTRATION || id == ONI_DEVICE_PROPERTY_SERIAL_NUMBER;
    }

    OniBool isImageRegistrationModeSupported(OniImageRegistrationMode mode) override {
        return mode == ONI_IMAGE_REGISTRATION_OFF || !sensor_.refuses(REGISTRATION);
    }

private:
    void give_pictures() {
        Shared& shared = *sensor_.shared;
        while (!over_) {
            std::this_thread::sleep_for(A_WHILE);
            std::lock_guard<std::mutex> guard(lock_);
            const uint32_t shown = shared.shown;
            if (!shared.plugged || shown == shared.given) continue;
            int running = 0;
            for (auto* stream : streams_) running += stream->running();
            if (running == 0) continue;
            for (auto* stream : streams_) stream->raise_picture(int(shown));
            shared.given = shown;
        }
    }

    const Sensor& sensor_;
    OniSensorInfo infos_[2];
    OniVideoMode modes_[2][2];
    std::mutex lock_;
    std::vector<Stream*> streams_;
    std::atomic<bool> registered_{false}, synchronised_{false}, over_{false};
    std::thread thread_;
};

class Driver : public DriverBase {
public:
    explicit Driver(OniDriverServices* services) : DriverBase(services) {}

    OniStatus initialize(DeviceConnectedCallback connected, DeviceDisconnectedCallback disconnected,
                         DeviceStateChangedCallback changed, void* cookie) override {
        DriverBase::initialize(connected, disconnected, changed, cookie);
        const char* folder = std::getenv("PUPPETLINE_VIRTUAL_SENSORS");
        for (int k = 0; folder != nullptr && k < SENSORS; k++) {
            const int file = open((std::string(folder) + "/" + std::to_string(k)).c_str(), O_RDWR);
            if (file < 0) return ONI_STATUS_ERROR;
            void* map = mmap(nullptr, SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
            close(file);
            if (map == MAP_FAILED) return ONI_STATUS_ERROR;
            sensors_[k].shared = static_cast<Shared*>(map);
            std::snprintf(sensors_[k].info.uri, ONI_MAX_STR, "virtual/%d", k);
            std::snprintf(sensors_[k].info.vendor, ONI_MAX_STR, "Puppetline");
            std::snprintf(sensors_[k].info.name, ONI_MAX_STR, "virtual sensor %d", k);
        }
        thread_ = std::thread([this] { watch_plugs(); });
        return ONI_STATUS_OK;
    }

    DeviceBase* deviceOpen(const char* uri, const char*) override {
        for (auto& sensor : sensors_)
            if (sensor.shared != nullptr && std::strcmp(uri, sensor.info.uri) == 0) {
                if (!sensor.refuses(OPENING)) return new Device(sensor);
                getServices().errorLoggerAppend("the virtual sensor refuses");
            }
        return nullptr;
    }

    void deviceClose(DeviceBase* device) override { delete device; }

    void* enableFrameSync(StreamBase** streams, int) override {
        return static_cast<Stream*>(streams[0])->synchronise();
    }

    void disableFrameSync(void* group) override { *static_cast<std::atomic<bool>*>(group) = false; }

    void shutdown() override {
        over_ = true;
        if (thread_.joinable()) thread_.join();
    }

private:
    void watch_plugs() {
        while (!over_) {
            for (auto& sensor : sensors_) {
                if (sensor.shared == nullptr || sensor.shared->plugged == sensor.shared->listed) continue;
                const uint32_t plugged = sensor.shared->plugged;
                plugged ? deviceConnected(&sensor.info) : deviceDisconnected(&sensor.info);
                sensor.shared->listed = plugged;
            }
            std::this_thread::sleep_for(A_WHILE);
        }
    }

    Sensor sensors_[SENSORS];
    std::atomic<bool> over_{false};
    std::thread thread_;
};

}  // namespace

ONI_EXPORT_DRIVER(Driver)
