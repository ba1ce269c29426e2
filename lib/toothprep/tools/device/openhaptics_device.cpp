#include "toothprep/tools/device/openhaptics_device.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/libhd.h"
#include "toothprep/tools/device/servo.h"
#include "toothprep/tools/device/tick_clock.h"

namespace toothprep {
namespace {

using namespace hdapi;

constexpr unsigned kCalibrationEvery = 50;  // ticks
constexpr double kClientTime = 0.05;        // s, for a client's tick when its driver is given up
constexpr int kMostErrors = 16;  // popped at once: a driver that never runs dry can't hold us

// What is assumed when a device doesn't say: the weakest and smallest of the family, so that no
// device is driven beyond its limits.
constexpr double kAssumedRate = 1000;             // Hz
constexpr double kAssumedForce = 3.3;             // N
constexpr double kAssumedContinuousForce = 0.88;  // N
constexpr double kAssumedStiffness = 0.4;         // N/mm
constexpr double kAssumedDamping = 4e-3;          // N·s/mm
const Vec3 kAssumedWorkspace(80, 60, 35);         // mm, either side of the origin

DeviceFault fault_of(HDerror code) noexcept {
  switch (code) {
    case HD_SUCCESS:
      return DeviceFault::kNone;
    case HD_WARM_MOTORS:
      return DeviceFault::kWarmMotors;
    case HD_EXCEEDED_MAX_FORCE:
      return DeviceFault::kForceExceeded;
    case HD_EXCEEDED_MAX_FORCE_IMPULSE:
      return DeviceFault::kImpulseExceeded;
    case HD_EXCEEDED_MAX_VELOCITY:
      return DeviceFault::kVelocityExceeded;
    case HD_COMM_ERROR:
    case HD_COMM_CONFIG_ERROR:
      return DeviceFault::kCommunication;
    case HD_TIMER_ERROR:
      return DeviceFault::kTimer;
    case HD_FORCE_ERROR:  // unlike its neighbours not to be recovered from
    case HD_DEVICE_FAULT:
      return DeviceFault::kDevice;
    case HD_BAD_HANDLE:
      return DeviceFault::kUnplugged;
    default:
      return DeviceFault::kRefused;
  }
}

// Column-major, as Eigen's default, translation in 12..14. What isn't a rotation (to 1e-3) becomes
// a quaternion that the servo refuses.
Quat orientation_of(const double transform[16]) noexcept {
  const Mat3 r = Eigen::Map<const Eigen::Matrix4d>(transform).topLeftCorner<3, 3>();
  if (!r.allFinite() || (r.transpose() * r - Mat3::Identity()).cwiseAbs().maxCoeff() > 1e-3 ||
      r.determinant() < 0)
    return Quat(0, 0, 0, 0);
  return Quat(r).normalized();
}

// The driver knows one set of devices and one servo loop per process, and so does this.
class OnlyOne {
 public:
  OnlyOne() {
    if (taken().exchange(true))
      throw Error(
          "openhaptics: a device is open already; the driver has one servo loop, so give both "
          "names at once (mirror) or close the first");
  }
  ~OnlyOne() { taken() = false; }
  OnlyOne(const OnlyOne&) = delete;

 private:
  static std::atomic<bool>& taken() {
    static std::atomic<bool> is_taken = false;
    return is_taken;
  }
};

class Driver {
 public:
  explicit Driver(LibHd lib) : lib_(std::move(lib)) {}

  const LibHd& operator*() const noexcept { return lib_; }
  const LibHd* operator->() const noexcept { return &lib_; }

  // Takes errors off the driver's stack. The worst of them, and its number.
  std::pair<DeviceFault, HDerror> take_errors() const noexcept {
    std::pair<DeviceFault, HDerror> worst(DeviceFault::kNone, HD_SUCCESS);
    for (int i = 0; i < kMostErrors; ++i) {
      const HDErrorInfo error = lib_.hdGetError();
      if (error.errorCode == HD_SUCCESS) break;
      const DeviceFault fault = fault_of(error.errorCode);
      if (fault >= worst.first) worst = {fault, error.errorCode};
    }
    return worst;
  }

  // "communication error (0x0302)"
  std::string name_of(HDerror code) const {
    const char* const text = lib_.hdGetErrorString(code);
    return fmt::format("{} (0x{:04x})", text && *text ? text : "error", code);
  }

  std::string text(HDenum what) const {
    const char* const value = lib_.hdGetString(what);
    return take_errors().second == HD_SUCCESS && value ? value : "";
  }
  std::optional<double> real(HDenum what) const {
    double value = std::nan("");
    lib_.hdGetDoublev(what, &value);
    if (take_errors().second != HD_SUCCESS || !std::isfinite(value)) return {};
    return value;
  }
  std::optional<int> integer(HDenum what) const {
    int value = 0;
    lib_.hdGetIntegerv(what, &value);
    if (take_errors().second != HD_SUCCESS) return {};
    return value;
  }

 private:
  LibHd lib_;
};

// A device that the driver has opened.
class OpenDevice {
 public:
  OpenDevice(const Driver& driver, const std::string& name) : driver_(driver) {
    driver_.take_errors();
    handle_ = driver_->hdInitDevice(name.empty() ? HD_DEFAULT_DEVICE : name.c_str());
    const HDerror code = driver_.take_errors().second;
    if (handle_ != HD_INVALID_HANDLE && code == HD_SUCCESS) {
      identify(name);
      return;
    }
    if (handle_ != HD_INVALID_HANDLE) driver_->hdDisableDevice(handle_);
    driver_.take_errors();
    throw Error("openhaptics: the driver did not open " +
                (name.empty() ? "the default device" : "the device '" + name + "'") + ": " +
                (code == HD_SUCCESS ? "no reason given" : driver_.name_of(code)) +
                "; check that it is switched on and connected, that you may use it (group dialout, "
                "for FireWire plugdev), and the name in the vendor's set-up program");
  }
  ~OpenDevice() {
    driver_->hdDisableDevice(handle_);
    driver_.take_errors();
  }
  OpenDevice(const OpenDevice&) = delete;

  HHD handle() const noexcept { return handle_; }
  const DeviceIdentity& identity() const noexcept { return identity_; }
  void make_current() const noexcept { driver_->hdMakeCurrentDevice(handle_); }

  // Checks, takes what the driver offers, and checks again. A reset of the encoders is left to
  // the user: it is right only while the arm is held in its rest.
  Calibration calibration() const {
    make_current();
    HDenum status = driver_->hdCheckCalibration();
    if (status == HD_CALIBRATION_NEEDS_UPDATE) {
      const HDenum styles = calibration_styles();
      for (const HDenum style : {HD_CALIBRATION_AUTO, HD_CALIBRATION_INKWELL})
        if (styles & style) {
          driver_->hdUpdateCalibration(style);
          break;
        }
      status = driver_->hdCheckCalibration();
    }
    if (const HDerror code = driver_.take_errors().second; code != HD_SUCCESS)
      throw Error("openhaptics: " + identity_.name + " does not report its calibration: " +
                  driver_.name_of(code) + "; check its cable and power, and open it again");
    if (status == HD_CALIBRATION_OK) return Calibration::kOk;
    return status == HD_CALIBRATION_NEEDS_UPDATE ? Calibration::kNeedsUpdate
                                                 : Calibration::kNeedsManualInput;
  }

  std::string how_to_calibrate() const {
    const HDenum styles = calibration_styles();
    if (styles & HD_CALIBRATION_INKWELL) return "put the stylus into its inkwell and try again";
    if (styles & HD_CALIBRATION_AUTO)
      return "move the stylus slowly through the whole workspace and try again";
    return "hold the arm in its reset position and run the vendor's calibration program";
  }

  // The state, inside a frame.
  DevicePose read() const noexcept {
    DevicePose pose;
    driver_->hdGetDoublev(HD_CURRENT_POSITION, pose.position.data());
    int buttons = 0;
    driver_->hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
    pose.buttons = static_cast<std::uint32_t>(buttons);
    if (has_transform_) {
      double transform[16] = {};
      driver_->hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
      pose.orientation = orientation_of(transform);
    }
    if (has_safety_switch_) {
      HDboolean held = 0;
      driver_->hdGetBooleanv(HD_CURRENT_SAFETY_SWITCH, &held);
      pose.safety_switch = held != 0;
    }
    return pose;
  }

  // Inside the first frame, without errors waiting: reads what not every device has, so that
  // read() reads only what this one has. Returns any other fault that this brings up.
  DeviceFault find_out_what_it_has(bool orientation) noexcept {
    double transform[16] = {};
    HDboolean held = 0;
    if (orientation) driver_->hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
    const DeviceFault first = driver_.take_errors().first;
    has_transform_ = orientation && first != DeviceFault::kRefused;
    driver_->hdGetBooleanv(HD_CURRENT_SAFETY_SWITCH, &held);
    const DeviceFault second = driver_.take_errors().first;
    has_safety_switch_ = second != DeviceFault::kRefused;
    return worse_of(has_transform_ ? first : DeviceFault::kNone,
                    has_safety_switch_ ? second : DeviceFault::kNone);
  }

 private:
  HDenum calibration_styles() const noexcept {
    make_current();
    int styles = 0;
    driver_->hdGetIntegerv(HD_CALIBRATION_STYLE, &styles);
    if (driver_.take_errors().second != HD_SUCCESS) styles = 0;
    return static_cast<HDenum>(styles);
  }

  void identify(const std::string& name) {
    make_current();
    identity_.name = name.empty() ? "default" : name;
    identity_.model = driver_.text(HD_DEVICE_MODEL_TYPE);
    identity_.vendor = driver_.text(HD_DEVICE_VENDOR);
    identity_.serial = driver_.text(HD_DEVICE_SERIAL_NUMBER);
    identity_.driver = "driver " + driver_.text(HD_DEVICE_DRIVER_VERSION) + ", HDAPI " +
                       driver_.text(HD_VERSION) + ", " + driver_->path;
    if (const std::optional<double> firmware = driver_.real(HD_DEVICE_FIRMWARE_VERSION))
      identity_.firmware = fmt::format("{:g}", *firmware);
  }

  const Driver& driver_;
  HHD handle_ = HD_INVALID_HANDLE;
  DeviceIdentity identity_;
  bool has_transform_ = false, has_safety_switch_ = false;
};

// As the current device reports; what isn't plausible is assumed, with a note.
DeviceLimits limits_of(const Driver& driver) {
  DeviceLimits limits;
  const auto number = [](double value) { return fmt::format("{:g}", value); };
  const auto plausible = [&](std::optional<double> reported, double low, double high,
                             double assumed, const char* name, const char* unit) {
    if (reported && *reported >= low && *reported <= high) return *reported;
    limits.notes.push_back(
        std::string(name) + ": assumed " + number(assumed) + " " + unit +
        (reported ? ", the device says " + number(*reported) : ", the device says none"));
    return assumed;
  };
  // The rate is an integer; some drivers give it as a double only.
  const std::optional<int> rate = driver.integer(HD_UPDATE_RATE);
  limits.rate = plausible(rate ? std::optional<double>(*rate) : driver.real(HD_UPDATE_RATE), 100,
                          10000, kAssumedRate, "servo rate", "Hz");
  limits.max_force =
      plausible(driver.real(HD_NOMINAL_MAX_FORCE), 0.1, 100, kAssumedForce, "maximum force", "N");
  limits.max_continuous_force =
      plausible(driver.real(HD_NOMINAL_MAX_CONTINUOUS_FORCE), 0.01, limits.max_force,
                std::min(kAssumedContinuousForce, limits.max_force), "continuous force", "N");
  limits.max_stiffness = plausible(driver.real(HD_NOMINAL_MAX_STIFFNESS), 1e-3, 100,
                                   kAssumedStiffness, "maximum stiffness", "N/mm");
  limits.max_damping = plausible(driver.real(HD_NOMINAL_MAX_DAMPING), 1e-6, 10, kAssumedDamping,
                                 "maximum damping", "N*s/mm");
  double box[6] = {};
  driver->hdGetDoublev(HD_USABLE_WORKSPACE_DIMENSIONS, box);
  const bool reported = driver.take_errors().second == HD_SUCCESS;
  const Vec3 low(box[0], box[1], box[2]), high(box[3], box[4], box[5]);
  const Vec3 size = high - low;
  if (reported && size.allFinite() && size.minCoeff() >= 10 && size.maxCoeff() <= 3000) {
    limits.workspace = Eigen::AlignedBox3d(low, high);
  } else {
    limits.workspace = Eigen::AlignedBox3d(-kAssumedWorkspace, kAssumedWorkspace);
    limits.notes.push_back("workspace: assumed 160 x 120 x 70 mm about the origin");
  }
  const std::optional<int> inputs = driver.integer(HD_INPUT_DOF);
  limits.has_orientation = inputs && *inputs >= 6;
  if (!inputs) limits.notes.push_back("orientation: the device does not say whether it has one");
  return limits;
}

class OpenHapticsDevice final : public HapticDevice {
 public:
  explicit OpenHapticsDevice(const OpenHapticsSettings& settings)
      : zero_force_wait_(settings.zero_force_wait),
        driver_(load_libhd(settings.library)),
        hand_(driver_, settings.name) {
    if (settings.mirror_name) mirror_.emplace(driver_, *settings.mirror_name);
    hand_.make_current();
    if (settings.rate) set_rate(*settings.rate);
    limits_ = limits_of(driver_);
    if (settings.rate) limits_.rate = static_cast<double>(*settings.rate);
    servo_.emplace(limits_.max_force, 1 / limits_.rate, settings.ramp);
  }
  ~OpenHapticsDevice() override { OpenHapticsDevice::stop(); }

  const DeviceIdentity& identity() const noexcept override { return hand_.identity(); }
  const DeviceIdentity* mirror_identity() const noexcept override {
    return mirror_ ? &mirror_->identity() : nullptr;
  }
  const DeviceLimits& limits() const noexcept override { return limits_; }
  void zero_force_soon() noexcept override { servo_->ask_to_close(); }
  DeviceStatus status() const noexcept override { return servo_->status(); }

  Calibration calibration() override {
    // While the servo runs, the current device and the errors belong to its thread.
    if (!started_) {
      calibration_ = hand_.calibration();
      if (mirror_) calibration_ = std::max(calibration_, mirror_->calibration());
    }
    return calibration_;
  }

  void start(ServoClient& client) override {
    if (started_) throw Error("openhaptics: the device runs already; stop it first");
    driver_.take_errors();
    require_calibration(hand_);
    if (mirror_) require_calibration(*mirror_);
    calibration_ = Calibration::kOk;
    enable_force();
    servo_->open(client);
    first_tick_ = true;
    ticks_ = 0;
    origin_ = monotonic_time();
    scheduled_ = driver_->hdScheduleAsynchronous(&OpenHapticsDevice::on_tick, this,
                                                 HD_MAX_SCHEDULER_PRIORITY);
    HDerror code = driver_.take_errors().second;
    if (code == HD_SUCCESS) {
      started_ = true;
      driver_->hdStartScheduler();
      // One look for what the start itself says: the errors are the servo's from here on.
      code = driver_->hdGetError().errorCode;
      if (severity_of(fault_of(code)) != FaultSeverity::kFinal) code = HD_SUCCESS;
    }
    if (code != HD_SUCCESS) {
      const std::string reason = driver_.name_of(code);
      if (started_)
        stop();
      else
        disable_force();
      throw Error("openhaptics: the driver's servo did not start: " + reason +
                  "; close other programs that use the device");
    }
  }

  bool in_tick_on_this_thread() const noexcept { return servo_->in_tick_on_this_thread(); }
  // The client isn't called any more, although the driver hangs and its servo may go on.
  void abandon() noexcept {
    servo_->ask_to_close();
    servo_->abandon(kClientTime);
  }

  void stop() noexcept override {
    if (!started_) return;
    servo_->ask_to_close();
    if (servo_->in_tick_on_this_thread()) return;
    const double deadline = monotonic_time() + zero_force_wait_;
    while (!servo_->sent_zero() && monotonic_time() < deadline)
      sleep_until(monotonic_time() + 5e-4);
    driver_->hdStopScheduler();
    driver_->hdUnschedule(scheduled_);
    disable_force();  // also when the servo didn't get to its zero
    servo_->closed();
    started_ = false;
  }

 private:
  void set_rate(long rate) {
    if (rate <= 0) throw Error("openhaptics: the servo rate must be above 0 Hz");
    driver_->hdSetSchedulerRate(static_cast<HDulong>(rate));
    if (const HDerror code = driver_.take_errors().second; code != HD_SUCCESS)
      throw Error("openhaptics: the driver does not run at " + std::to_string(rate) + " Hz: " +
                  driver_.name_of(code) + "; most devices know 500, 1000 and 1600 or 2000 Hz");
  }

  static void require_calibration(const OpenDevice& device) {
    if (device.calibration() != Calibration::kOk)
      throw Error("openhaptics: " + device.identity().name + " is not calibrated; " +
                  device.how_to_calibrate());
  }

  void enable_force() {
    if (mirror_) {
      mirror_->make_current();
      driver_->hdDisable(HD_FORCE_OUTPUT);
    }
    hand_.make_current();
    driver_.take_errors();
    const std::pair<HDenum, const char*> safeguards[] = {
        {HD_MAX_FORCE_CLAMPING, "clamping of the force"},
        {HD_SOFTWARE_FORCE_LIMIT, "the software force limit"},
        {HD_FORCE_RAMPING, "ramping of the force"}};
    for (const auto& [capability, name] : safeguards) {
      driver_->hdEnable(capability);
      const HDerror code = driver_.take_errors().second;
      if (code != HD_SUCCESS) note_once("the driver lacks " + std::string(name));
    }
    driver_->hdEnable(HD_FORCE_OUTPUT);
    const HDerror code = driver_.take_errors().second;
    const bool enabled = driver_->hdIsEnabled(HD_FORCE_OUTPUT);
    driver_.take_errors();
    if (code != HD_SUCCESS || !enabled) {
      disable_force();
      throw Error("openhaptics: the driver does not enable forces: " +
                  (code == HD_SUCCESS ? "no reason given" : driver_.name_of(code)) +
                  "; close and open the device again");
    }
  }
  void disable_force() const noexcept {
    hand_.make_current();
    driver_->hdDisable(HD_FORCE_OUTPUT);
    driver_.take_errors();
  }
  void note_once(const std::string& note) {
    for (const std::string& known : limits_.notes)
      if (known == note) return;
    limits_.notes.push_back(note);
  }

  // ---- On the servo's thread.

  static unsigned int on_tick(void* self) {
    static_cast<OpenHapticsDevice*>(self)->tick();
    return HD_CALLBACK_CONTINUE;  // for good: after a final fault it keeps sending zero until
                                  // stop()
  }

  void tick() noexcept {
    DeviceFault fault = DeviceFault::kNone;
    DevicePose other;
    if (mirror_) {  // a frame of its own; no force is set, and none is enabled
      fault = begin_frame(*mirror_);
      other = mirror_->read();
      driver_->hdEndFrame(mirror_->handle());
    }
    fault = worse_of(fault, begin_frame(hand_));
    // After the reading: one that a pause made older than its time is known by the time.
    const double time = monotonic_time() - origin_;
    // Some devices know only once they talk to the driver, and one may lose it on the way.
    if (ticks_++ % kCalibrationEvery == 0 &&
        driver_->hdCheckCalibration() == HD_CALIBRATION_NEEDS_MANUAL_INPUT)
      fault = worse_of(fault, DeviceFault::kNotCalibrated);
    first_tick_ = false;
    const DevicePose hand = hand_.read();
    fault = worse_of(fault, take_errors());

    const Vec3 force = servo_->begin_tick(time, hand, mirror_ ? &other : nullptr, fault);
    // A driver may have switched forces off after a fault.
    if (servo_->recovering() && !driver_->hdIsEnabled(HD_FORCE_OUTPUT))
      driver_->hdEnable(HD_FORCE_OUTPUT);
    driver_->hdSetDoublev(HD_CURRENT_FORCE, force.data());
    driver_->hdEndFrame(hand_.handle());
    servo_->report(take_errors());
    servo_->end_tick();
  }

  DeviceFault begin_frame(OpenDevice& device) noexcept {
    device.make_current();
    driver_->hdBeginFrame(device.handle());
    const DeviceFault fault = take_errors();
    if (!first_tick_) return fault;
    return worse_of(fault, device.find_out_what_it_has(limits_.has_orientation));
  }

  DeviceFault take_errors() noexcept {
    const auto [fault, code] = driver_.take_errors();
    if (fault != DeviceFault::kNone && servo_->running()) servo_->note_driver_code(code);
    return fault;
  }

  const double zero_force_wait_;
  OnlyOne only_one_;
  Driver driver_;
  OpenDevice hand_;
  std::optional<OpenDevice> mirror_;
  DeviceLimits limits_;
  std::optional<Servo> servo_;
  Calibration calibration_ = Calibration::kNeedsManualInput;
  HDSchedulerHandle scheduled_ = 0;
  double origin_ = 0;
  bool started_ = false, first_tick_ = true;
  unsigned ticks_ = 0;
};

std::atomic<bool> given_up = false;

// The one thread that opens, starts, stops and closes the device, so that a driver that hangs in it
// doesn't hang the program.
class DriverThread {
 public:
  explicit DriverThread(const std::function<bool()>& stop_asked) : stop_asked_(stop_asked) {}
  ~DriverThread() {
    if (hangs_) {
      thread_.detach();
    } else {
      shared_->ask([&] { shared_->leave = true; });
      thread_.join();
    }
  }
  DriverThread(const DriverThread&) = delete;
  DriverThread& operator=(const DriverThread&) = delete;

  // Runs `work` there; what it throws is thrown here. False if it hasn't come back after so many
  // seconds, or when the program was asked to stop: then the thread is left to the driver, with
  // whatever it uses, and nothing can be run any more.
  bool run(std::function<void()> work, double seconds, bool until_stop_asked = false) {
    if (hangs_) return false;
    const double deadline = monotonic_time() + seconds;
    shared_->ask([&] {
      shared_->work = std::move(work);
      shared_->busy = true;
    });
    while (!shared_->wait()) {
      const bool asked = until_stop_asked && stop_asked_ && stop_asked_();
      if (!asked && monotonic_time() < deadline) continue;
      stopped_ = asked;
      hangs_ = given_up = true;
      return false;
    }
    if (shared_->error) std::rethrow_exception(std::exchange(shared_->error, nullptr));
    return true;
  }
  bool hangs() const noexcept { return hangs_; }

  // Why a call of run() was false.
  std::string reason(const char* doing, double seconds) const {
    if (stopped_) return fmt::format("openhaptics: asked to stop while the driver {}", doing);
    return fmt::format(
        "openhaptics: the driver hangs: for {:g} s it has not come back while it {}; switch the "
        "device off and on, close other programs that use it, and try again",
        seconds, doing);
  }

 private:
  struct Shared {  // the thread may outlive the device
    std::mutex mutex;
    std::condition_variable changed;
    std::function<void()> work;
    std::exception_ptr error;
    bool busy = false, leave = false;

    template <class Change>
    void ask(const Change& change) {
      const std::lock_guard lock(mutex);
      change();
      changed.notify_all();
    }
    bool wait() {  // for a moment; whether it is done
      std::unique_lock lock(mutex);
      return changed.wait_for(lock, std::chrono::milliseconds(20), [this] { return !busy; });
    }
    void run() {
      std::unique_lock lock(mutex);
      for (;;) {
        changed.wait(lock, [this] { return busy || leave; });
        if (leave) return;
        lock.unlock();
        std::exception_ptr thrown;
        try {
          work();
        } catch (...) {
          thrown = std::current_exception();
        }
        lock.lock();
        error = thrown;
        busy = false;
        changed.notify_all();
      }
    }
  };

  std::function<bool()> stop_asked_;
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
  std::thread thread_{[shared = shared_] { shared->run(); }};
  std::atomic<bool> hangs_ = false;
  bool stopped_ = false;
};

// A driver that hangs must not hang the program: opening, starting, stopping and closing are waited
// for only so long. After that the driver is left alone, with its memory.
class BoundedDevice final : public HapticDevice {
 public:
  explicit BoundedDevice(const OpenHapticsSettings& settings)
      : settings_(settings), driver_(settings.stop_asked) {
    const auto opened = std::make_shared<OpenHapticsDevice*>(nullptr);
    if (!driver_.run([opened, settings] { *opened = new OpenHapticsDevice(settings); },
                     settings.open_wait, true))
      throw Error(driver_.reason("opens the device", settings.open_wait));
    device_ = *opened;
  }
  ~BoundedDevice() override {
    BoundedDevice::stop();
    bounded([device = device_] { delete device; });
  }

  const DeviceIdentity& identity() const noexcept override { return device_->identity(); }
  const DeviceIdentity* mirror_identity() const noexcept override {
    return device_->mirror_identity();
  }
  const DeviceLimits& limits() const noexcept override { return device_->limits(); }

  Calibration calibration() override {
    const auto calibration = std::make_shared<Calibration>();
    if (!driver_.run([calibration, device = device_] { *calibration = device->calibration(); },
                     settings_.start_wait, true))
      throw Error(driver_.reason("looks at the calibration", settings_.start_wait));
    return *calibration;
  }

  void start(ServoClient& client) override {
    if (driver_.run([&client, device = device_] { device->start(client); }, settings_.start_wait,
                    true))
      return;
    device_->abandon();
    throw Error(driver_.reason("starts its servo", settings_.start_wait));
  }

  void stop() noexcept override {
    if (device_->in_tick_on_this_thread()) return device_->stop();
    bounded([device = device_] { device->stop(); });
  }

  void zero_force_soon() noexcept override { device_->zero_force_soon(); }

  DeviceStatus status() const noexcept override {
    DeviceStatus status = device_->status();
    if (!driver_.hangs()) return status;
    status.state = ServoState::kFaulted;
    status.last_fault = DeviceFault::kHangs;
    return status;
  }

 private:
  void bounded(const std::function<void()>& work) noexcept {
    try {
      if (!driver_.run(work, settings_.stop_wait)) device_->abandon();
    } catch (const std::exception&) {  // neither throws
    }
  }

  OpenHapticsSettings settings_;
  DriverThread driver_;
  OpenHapticsDevice* device_ = nullptr;  // deleted in time, or left to the driver
};

}  // namespace

std::unique_ptr<HapticDevice> open_openhaptics(const OpenHapticsSettings& settings) {
  return std::make_unique<BoundedDevice>(settings);
}

bool driver_was_given_up() noexcept { return given_up; }

}  // namespace toothprep
