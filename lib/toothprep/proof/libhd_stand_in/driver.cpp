#include "driver.h"

#include <algorithm>
#include <cstdio>
#include <exception>
#include <utility>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/tick_clock.h"

namespace toothprep::stand_in {
namespace {

using namespace hdapi;

constexpr std::size_t kMostErrors = 256;  // kept; older ones are forgotten
constexpr long kMostCaughtUp = 1000;      // ticks after a pause of the machine
// Handles are longer than 32 bits, so that a program that cuts them off is found out.
constexpr HDSchedulerHandle kFirstHandle = 0x100000001;

thread_local bool in_callback = false;

struct Parameter {
  HDenum what;
  Type type;
  bool state;  // read inside a frame
};
constexpr Parameter kParameters[] = {
    {HD_CURRENT_BUTTONS, Type::kInteger, true},
    {HD_CURRENT_SAFETY_SWITCH, Type::kBoolean, true},
    {HD_CURRENT_INKWELL_SWITCH, Type::kBoolean, true},
    {HD_CURRENT_ENCODER_VALUES, Type::kLong, true},
    {HD_CURRENT_POSITION, Type::kReal, true},
    {HD_CURRENT_VELOCITY, Type::kReal, true},
    {HD_CURRENT_TRANSFORM, Type::kReal, true},
    {HD_CURRENT_FORCE, Type::kReal, true},
    {HD_VERSION, Type::kString, false},
    {HD_DEVICE_MODEL_TYPE, Type::kString, false},
    {HD_DEVICE_DRIVER_VERSION, Type::kString, false},
    {HD_DEVICE_VENDOR, Type::kString, false},
    {HD_DEVICE_SERIAL_NUMBER, Type::kString, false},
    {HD_DEVICE_FIRMWARE_VERSION, Type::kReal, false},
    {HD_MAX_WORKSPACE_DIMENSIONS, Type::kReal, false},
    {HD_USABLE_WORKSPACE_DIMENSIONS, Type::kReal, false},
    {HD_INPUT_DOF, Type::kInteger, false},
    {HD_OUTPUT_DOF, Type::kInteger, false},
    {HD_CALIBRATION_STYLE, Type::kInteger, false},
    {HD_UPDATE_RATE, Type::kInteger, false},
    {HD_INSTANTANEOUS_UPDATE_RATE, Type::kInteger, false},
    {HD_NOMINAL_MAX_STIFFNESS, Type::kReal, false},
    {HD_NOMINAL_MAX_FORCE, Type::kReal, false},
    {HD_NOMINAL_MAX_CONTINUOUS_FORCE, Type::kReal, false},
    {HD_NOMINAL_MAX_DAMPING, Type::kReal, false},
};

const Parameter* parameter_of(HDenum what) {
  for (const Parameter& p : kParameters)
    if (p.what == what) return &p;
  return nullptr;
}

int give(double* values, const Vec3& v) {
  Eigen::Map<Vec3> out(values);
  out = v;
  return 3;
}
int give(double* values, double v) {
  values[0] = v;
  return 1;
}

std::uint32_t flag_of(FaultKind kind) {
  switch (kind) {
    case FaultKind::kPoseJump:
    case FaultKind::kNan:
      return kJumped;
    case FaultKind::kFrozen:
      return kStands;
    case FaultKind::kLostCalibration:
      return kUncalibrated;
    case FaultKind::kLetGo:
      return kSwitchOpened;
    default:
      return 0;
  }
}

}  // namespace

Driver::Driver() : next_handle_(kFirstHandle) {
  errors_.reserve(kMostErrors);
  waiting_.reserve(16);
}

Driver::~Driver() { stop(); }

// ---- Errors.

void Driver::push_error(HDerror code, HHD handle, int internal) {
  if (errors_.size() == kMostErrors) errors_.erase(errors_.begin());
  errors_.push_back({code, internal, handle});
}

void Driver::misuse(HDerror code, HHD handle, const char* what) {
  if (misuses_++ == 0) first_misuse_ = what;
  push_error(code, handle);
}

HDErrorInfo Driver::pop_error() {
  const Lock lock(mutex_);
  if (errors_.empty()) return {HD_SUCCESS, 0, HD_INVALID_HANDLE};
  const HDErrorInfo error = errors_.back();
  errors_.pop_back();
  return error;
}

const char* Driver::error_text(HDerror code) {
  switch (code) {
    case HD_SUCCESS:
      return "success";
    case HD_INVALID_ENUM:
      return "unknown parameter";
    case HD_INVALID_VALUE:
      return "invalid value";
    case HD_INVALID_OPERATION:
      return "operation not possible";
    case HD_INVALID_INPUT_TYPE:
      return "wrong type for the parameter";
    case HD_BAD_HANDLE:
      return "unknown device handle";
    case HD_WARM_MOTORS:
      return "warm motors";
    case HD_EXCEEDED_MAX_FORCE:
      return "maximum force exceeded";
    case HD_EXCEEDED_MAX_FORCE_IMPULSE:
      return "maximum change of force exceeded";
    case HD_EXCEEDED_MAX_VELOCITY:
      return "maximum velocity exceeded";
    case HD_FORCE_ERROR:
      return "force error";
    case HD_DEVICE_FAULT:
      return fault_text_.c_str();
    case HD_DEVICE_ALREADY_INITIATED:
      return "device already open";
    case HD_COMM_ERROR:
      return "communication error";
    case HD_COMM_CONFIG_ERROR:
      return "communication set-up error";
    case HD_TIMER_ERROR:
      return "timer error";
    case HD_ILLEGAL_BEGIN:
      return "frame begun illegally";
    case HD_ILLEGAL_END:
      return "frame ended illegally";
    case HD_FRAME_ERROR:
      return "frame error";
    case HD_INVALID_PRIORITY:
      return "invalid priority";
    case HD_SCHEDULER_FULL:
      return "scheduler full";
    case HD_INVALID_LICENSE:
      return "invalid license";
    default:
      return "unknown error";
  }
}

// ---- Devices and frames.

bool Driver::any_open() const {
  return std::any_of(devices_.begin(), devices_.end(), [](const auto& d) { return d != nullptr; });
}

Driver::Device* Driver::device_of(HHD handle) {
  if (handle >= devices_.size() || !devices_[handle]) {
    misuse(HD_BAD_HANDLE, handle, "a handle of no open device");
    return nullptr;
  }
  if (devices_[handle]->unplugged) {
    push_error(HD_BAD_HANDLE, handle);
    return nullptr;
  }
  return devices_[handle].get();
}

Driver::Device* Driver::current_device(const char* caller) {
  if (current_ == HD_INVALID_HANDLE) {
    misuse(HD_INVALID_OPERATION, current_, caller);
    return nullptr;
  }
  return device_of(current_);
}

void Driver::create(unsigned index) {
  Disturbances disturbances = settings_.disturbances;
  disturbances.seed += index;
  const HandSettings& hand = index == 0 ? settings_.hand : settings_.mirror;
  devices_[index] = std::make_unique<Device>(
      SimulatedArm(settings_.phantom, settings_.hand_model, motion_of(hand), disturbances));
  devices_[index]->calibration = settings_.calibration;
}

// For good, as a driver that waits for an answer that doesn't come.
void Driver::hang_if(FaultKind kind) const {
  for (const FaultSettings& fault : settings_.faults)
    while (fault.kind == kind) std::this_thread::sleep_for(std::chrono::hours(1));
}

HHD Driver::init(const char* name) {
  const HHD handle = open(name);
  hang_if(FaultKind::kHangingOpen);
  return handle;
}

HHD Driver::open(const char* name) {
  const Lock lock(mutex_);
  try {
    if (!configured_ && !any_open()) settings_ = settings_of_environment();
    if (!settings_.log.empty() && !any_open())
      log_ = std::make_unique<TickLog>(settings_.log, settings_.phantom.rate,
                                       static_cast<std::size_t>(settings_.log_ticks));
    devices_.resize(settings_.names.size());
    fault_text_ = "device fault";
    unsigned index = 0;
    if (name)
      while (index < settings_.names.size() && settings_.names[index] != name) ++index;
    if (!settings_.present || index == settings_.names.size()) {
      push_error(HD_DEVICE_FAULT, HD_INVALID_HANDLE);
      return HD_INVALID_HANDLE;
    }
    if (devices_[index]) {
      push_error(HD_DEVICE_ALREADY_INITIATED, index);
      return HD_INVALID_HANDLE;
    }
    create(index);
    return current_ = index;
  } catch (const std::exception& e) {
    fault_text_ = std::string("stand-in: ") + e.what();
    push_error(HD_DEVICE_FAULT, HD_INVALID_HANDLE);
    return HD_INVALID_HANDLE;
  }
}

void Driver::disable_device(HHD handle) {
  const Lock lock(mutex_);
  if (handle >= devices_.size() || !devices_[handle])
    return misuse(HD_BAD_HANDLE, handle, "hdDisableDevice of no open device");
  if (running_) misuse(HD_INVALID_OPERATION, handle, "hdDisableDevice while the servo runs");
  closed_.resize(devices_.size());
  closed_[handle] = state_of(*devices_[handle]);
  devices_[handle].reset();
  if (current_ == handle) current_ = HD_INVALID_HANDLE;
}

void Driver::make_current(HHD handle) {
  const Lock lock(mutex_);
  if (device_of(handle)) current_ = handle;
}

HHD Driver::current() {
  const Lock lock(mutex_);
  return current_;
}

void Driver::begin_frame(HHD handle) {
  const Lock lock(mutex_);
  Device* const device = device_of(handle);
  if (!device) return;
  if (!in_callback) return misuse(HD_ILLEGAL_BEGIN, handle, "hdBeginFrame outside the servo");
  if (device->in_frame || (device->had_frame && device->one_frame))
    return misuse(HD_ILLEGAL_BEGIN, handle, "a second hdBeginFrame in a tick");
  device->in_frame = device->had_frame = true;
  device->set_force = Vec3::Zero();
  current_ = handle;
  // What the device says of itself comes before forces, errors of forces after them.
  if (device->injected_ticks > 0 && device->injected >= HD_DEVICE_FAULT)
    push_error(device->injected, handle);
}

void Driver::end_frame(HHD handle) {
  const Lock lock(mutex_);
  Device* const device = device_of(handle);
  if (!device) return;
  if (!device->in_frame) return misuse(HD_ILLEGAL_END, handle, "hdEndFrame without hdBeginFrame");
  device->in_frame = false;
  ++device->frames;
  device->commanded_force = device->set_force;
  const double norm = device->commanded_force.norm();
  if (norm > settings_.max_force && device->force_output) {
    if (device->clamping) {
      device->commanded_force *= settings_.max_force / norm;
    } else {
      device->force_output = false;
      push_error(HD_EXCEEDED_MAX_FORCE, handle);
    }
  }
  if (device->injected_ticks > 0 && device->injected < HD_DEVICE_FAULT) {
    if (device->injected == HD_EXCEEDED_MAX_FORCE) device->force_output = false;
    push_error(device->injected, handle);
  }
  device->motor_force = device->force_output ? device->commanded_force : Vec3::Zero();
}

// ---- Values.

int Driver::get(HDenum what, Type type, double* values) {
  const Lock lock(mutex_);
  Device* const device = current_device("hdGet without a current device");
  if (!device) return 0;
  const Parameter* const parameter = parameter_of(what);
  const auto fail = [&](HDerror code) {
    push_error(code, current_);
    return 0;
  };
  if (!parameter) {
    misuse(HD_INVALID_ENUM, current_, "hdGet of an unknown parameter");
    return 0;
  }
  for (const double refused : settings_.refused)
    if (refused == what) return fail(HD_INVALID_OPERATION);
  if (what == HD_CURRENT_SAFETY_SWITCH && !settings_.has_safety_switch)
    return fail(HD_INVALID_OPERATION);
  if (what == HD_UPDATE_RATE && settings_.rate_as_double) {
    if (type != Type::kReal) return fail(HD_INVALID_INPUT_TYPE);
  } else if (parameter->type != type) {
    misuse(HD_INVALID_INPUT_TYPE, current_, "hdGet with the wrong type for the parameter");
    return 0;
  }
  if (parameter->state && !device->in_frame) {
    misuse(HD_FRAME_ERROR, current_, "state read outside a frame");
    return 0;
  }
  const DevicePose& pose = device->latched;
  switch (what) {
    case HD_CURRENT_BUTTONS:
      return give(values, static_cast<double>(pose.buttons));
    case HD_CURRENT_SAFETY_SWITCH:
      return give(values, lasts(FaultKind::kLetGo, current_) ? 0 : 1);
    case HD_CURRENT_INKWELL_SWITCH:
      return give(values, 0);
    case HD_CURRENT_ENCODER_VALUES:
      for (int i = 0; i < 3; ++i)
        values[i] = settings_.phantom.encoder_count > 0
                        ? std::floor(pose.position[i] / settings_.phantom.encoder_count + 0.5)
                        : 0;
      std::fill(values + 3, values + 6, 0.0);
      return 6;
    case HD_CURRENT_POSITION:
      return give(values, pose.position);
    case HD_CURRENT_VELOCITY:
      return give(values, device->arm.phantom().true_velocity());
    case HD_CURRENT_TRANSFORM: {
      Eigen::Map<Eigen::Matrix4d> transform(values);  // column-major
      transform.setIdentity();
      if (settings_.has_orientation)
        transform.topLeftCorner<3, 3>() = pose.orientation.toRotationMatrix();
      transform.topRightCorner<3, 1>() = pose.position;
      return 16;
    }
    case HD_CURRENT_FORCE:
      return give(values, device->set_force);
    case HD_DEVICE_FIRMWARE_VERSION:
      return give(values, 1.5);
    case HD_MAX_WORKSPACE_DIMENSIONS:
    case HD_USABLE_WORKSPACE_DIMENSIONS: {
      const Eigen::AlignedBox3d box(Vec3(-80, -60, -60), Vec3(80, 60, 60));
      give(values, Vec3(box.min()));
      give(values + 3, Vec3(box.max()));
      return 6;
    }
    case HD_INPUT_DOF:
      return give(values, settings_.has_orientation ? 6 : 3);
    case HD_OUTPUT_DOF:
      return give(values, 3);
    case HD_CALIBRATION_STYLE:
      return give(values, settings_.calibration_style);
    case HD_UPDATE_RATE:
    case HD_INSTANTANEOUS_UPDATE_RATE:
      return give(values, settings_.phantom.rate);
    case HD_NOMINAL_MAX_STIFFNESS:
      return give(values, settings_.max_stiffness);
    case HD_NOMINAL_MAX_FORCE:
      return give(values, settings_.max_force);
    case HD_NOMINAL_MAX_CONTINUOUS_FORCE:
      return give(values, settings_.continuous_force);
    case HD_NOMINAL_MAX_DAMPING:
      return give(values, settings_.max_damping);
    default:
      return 0;
  }
}

const char* Driver::text(HDenum what) {
  const Lock lock(mutex_);
  const Parameter* const parameter = parameter_of(what);
  if (!parameter || parameter->type != Type::kString) {
    misuse(HD_INVALID_ENUM, current_, "hdGetString of no text");
    return nullptr;
  }
  for (const double refused : settings_.refused)
    if (refused == what) {
      push_error(HD_INVALID_OPERATION, current_);
      return nullptr;
    }
  switch (what) {
    case HD_DEVICE_MODEL_TYPE:
      return settings_.model.c_str();
    case HD_DEVICE_VENDOR:
      return "toothprep stand-in";
    case HD_DEVICE_SERIAL_NUMBER:
      return current_ == 0 ? "0001" : "0002";
    default:
      return "stand-in";
  }
}

void Driver::set(HDenum what, Type type, const double* three) {
  const Lock lock(mutex_);
  Device* const device = current_device("hdSet without a current device");
  if (!device) return;
  if (what != HD_CURRENT_FORCE)
    return misuse(HD_INVALID_ENUM, current_, "hdSet of what the stand-in doesn't set");
  if (type != Type::kReal)
    return misuse(HD_INVALID_INPUT_TYPE, current_, "hdSet with the wrong type for the parameter");
  if (!device->in_frame) return misuse(HD_FRAME_ERROR, current_, "a force set outside a frame");
  const Vec3 force(three[0], three[1], three[2]);
  if (!force.allFinite()) return misuse(HD_INVALID_VALUE, current_, "a force that is not finite");
  if (device->calibration != HD_CALIBRATION_OK && force != Vec3::Zero())
    return misuse(HD_FORCE_ERROR, current_, "a force before calibration");
  device->set_force = force;
}

void Driver::set_capability(HDenum capability, bool enabled) {
  const Lock lock(mutex_);
  Device* const device = current_device("hdEnable or hdDisable without a current device");
  if (!device) return;
  for (const double refused : settings_.refused)
    if (refused == capability) return push_error(HD_INVALID_ENUM, current_);
  switch (capability) {
    case HD_FORCE_OUTPUT:
      if (enabled && device->calibration != HD_CALIBRATION_OK)
        return misuse(HD_INVALID_OPERATION, current_, "forces enabled before calibration");
      device->force_output = enabled;
      if (enabled) return;
      device->motor_force = Vec3::Zero();
      if (current_ == 0 && !in_callback) log(kMotorsReleased);
      return;
    case HD_MAX_FORCE_CLAMPING:
      device->clamping = enabled;
      return;
    case HD_FORCE_RAMPING:
      device->ramping = enabled;
      return;
    case HD_SOFTWARE_FORCE_LIMIT:
      device->force_limit = enabled;
      return;
    case HD_ONE_FRAME_LIMIT:
      device->one_frame = enabled;
      return;
    default:
      return misuse(HD_INVALID_ENUM, current_, "an unknown capability");
  }
}

bool Driver::is_enabled(HDenum capability) {
  const Lock lock(mutex_);
  Device* const device = current_device("hdIsEnabled without a current device");
  if (!device) return false;
  switch (capability) {
    case HD_FORCE_OUTPUT:
      return device->force_output;
    case HD_MAX_FORCE_CLAMPING:
      return device->clamping;
    case HD_FORCE_RAMPING:
      return device->ramping;
    case HD_SOFTWARE_FORCE_LIMIT:
      return device->force_limit;
    case HD_ONE_FRAME_LIMIT:
      return device->one_frame;
    default:
      misuse(HD_INVALID_ENUM, current_, "an unknown capability");
      return false;
  }
}

// ---- Calibration.

HDenum Driver::check_calibration() {
  const Lock lock(mutex_);
  Device* const device = current_device("hdCheckCalibration without a current device");
  if (lasts(FaultKind::kLostCalibration, current_)) return HD_CALIBRATION_NEEDS_MANUAL_INPUT;
  return device ? device->calibration : HD_CALIBRATION_NEEDS_MANUAL_INPUT;
}

HDenum Driver::calibration_style() {
  const Lock lock(mutex_);
  return settings_.calibration_style;
}

void Driver::update_calibration(HDenum style) {
  const Lock lock(mutex_);
  Device* const device = current_device("hdUpdateCalibration without a current device");
  if (!device) return;
  if (style != settings_.calibration_style)
    return misuse(HD_DEVICE_FAULT, current_, "a style of calibration that the device lacks");
  if (device->calibration == HD_CALIBRATION_NEEDS_UPDATE) device->calibration = HD_CALIBRATION_OK;
}

// ---- Scheduler.

void Driver::start() {
  start_servo();
  hang_if(FaultKind::kHangingStart);
}

void Driver::start_servo() {
  const Lock lock(mutex_);
  if (running_) return misuse(HD_INVALID_OPERATION, current_, "hdStartScheduler of a running one");
  if (settings_.start_fails) return push_error(HD_TIMER_ERROR, current_);
  running_ = true;
  leave_ = false;
  first_tick_ = clock_tick_;
  this_tick_ = -1;
  if (!settings_.stepped) thread_ = std::thread([this] { run_in_real_time(); });
}

void Driver::stop() {
  hang_if(FaultKind::kHangingStop);
  {
    const Lock lock(mutex_);
    if (in_callback)
      return misuse(HD_INVALID_OPERATION, current_, "hdStopScheduler from the servo");
    if (!running_) return;
    leave_ = true;
  }
  if (thread_.joinable()) thread_.join();
  const Lock lock(mutex_);
  running_ = false;
  release_motors();
  changed_.notify_all();
}

void Driver::set_rate(unsigned long hz) {
  const Lock lock(mutex_);
  if (hz != 500 && hz != 1000 && hz != 2000) return push_error(HD_INVALID_VALUE, current_);
  if (running_) return misuse(HD_INVALID_OPERATION, current_, "a new rate while the servo runs");
  settings_.phantom.rate = static_cast<double>(hz);
  for (unsigned i = 0; i < devices_.size(); ++i)
    if (devices_[i]) create(i);
}

HDSchedulerHandle Driver::schedule(HDSchedulerCallback callback, void* data, HDushort priority) {
  hang_if(FaultKind::kHangingSchedule);
  const Lock lock(mutex_);
  for (Scheduled& s : scheduled_)
    if (s.handle == 0) {
      s = {next_handle_++, callback, data, priority};
      const HDSchedulerHandle handle = s.handle;
      std::sort(scheduled_.begin(), scheduled_.end(), [](const Scheduled& a, const Scheduled& b) {
        return a.priority > b.priority || (a.priority == b.priority && a.handle < b.handle);
      });
      return handle;
    }
  push_error(HD_SCHEDULER_FULL, current_);
  return 0;
}

void Driver::schedule_and_wait(HDSchedulerCallback callback, void* data) {
  if (in_callback) {
    callback(data);
    return;
  }
  Waiting waiting{callback, data};
  Lock lock(mutex_);
  if (!running_ || settings_.stepped)
    return misuse(HD_INVALID_OPERATION, current_, "hdScheduleSynchronous without a servo");
  waiting_.push_back(&waiting);
  changed_.wait(lock, [&] { return waiting.done || !running_; });
  if (!waiting.done) std::erase(waiting_, &waiting);
}

void Driver::unschedule(HDSchedulerHandle handle) {
  const Lock lock(mutex_);
  for (Scheduled& s : scheduled_)
    if (handle != 0 && s.handle == handle) {
      s = {};
      return;
    }
  misuse(HD_INVALID_OPERATION, current_, "hdUnschedule of no scheduled callback");
}

bool Driver::wait(HDSchedulerHandle handle, HDenum code) {
  Lock lock(mutex_);
  const auto scheduled = [&] {
    return std::any_of(scheduled_.begin(), scheduled_.end(),
                       [&](const Scheduled& s) { return s.handle == handle; });
  };
  if (code == HD_WAIT_INFINITE) changed_.wait(lock, [&] { return !scheduled() || !running_; });
  return scheduled();
}

double Driver::time_in_tick() {
  const Lock lock(mutex_);
  return monotonic_time() - tick_began_;
}

// ---- The servo loop.

void Driver::begin_tick() {
  tick_began_ = monotonic_time();
  last_tick_ = std::exchange(this_tick_, clock_tick_ - first_tick_);
  for (const FaultSettings& fault : settings_.faults) {
    if (!begins(fault) || fault.device >= devices_.size() || !devices_[fault.device]) continue;
    Device& device = *devices_[fault.device];
    if (fault.kind == FaultKind::kUnplugged) unplug(device);
    if (fault.kind != FaultKind::kError) continue;
    device.asked = fault.code;
    device.asked_ticks = fault.ticks;
  }
  for (unsigned i = 0; i < devices_.size(); ++i) {
    Device* const device = devices_[i].get();
    if (device == nullptr) continue;
    if (device->asked_ticks > 0) {
      device->injected = device->asked;
      device->injected_ticks = std::exchange(device->asked_ticks, 0);
    }
    device->had_frame = false;
    device->flags = 0;
    device->latched = device->arm.read(time());
    disturb(i, *device);
  }
}

// In the first tick that comes from then on: the machine may leave some out.
bool Driver::begins(const FaultSettings& fault) const {
  return last_tick_ < fault.at_tick && fault.at_tick <= this_tick_;
}

bool Driver::lasts(const FaultSettings& fault) const {
  return running_ && fault.at_tick <= this_tick_ &&
         (begins(fault) || this_tick_ < fault.at_tick + fault.ticks);
}

bool Driver::lasts(FaultKind kind, HHD device) const {
  for (const FaultSettings& fault : settings_.faults)
    if (fault.kind == kind && fault.device == device && lasts(fault)) return true;
  return false;
}

// What the device says of its pose.
void Driver::disturb(unsigned index, Device& device) {
  const DevicePose before = device.frozen;
  device.frozen = device.latched;
  for (const FaultSettings& fault : settings_.faults) {
    if (fault.device != index || !lasts(fault)) continue;
    if (fault.kind == FaultKind::kPoseJump) device.latched.position += fault.offset;
    if (fault.kind == FaultKind::kNan) device.latched.position.setConstant(std::nan(""));
    if (fault.kind == FaultKind::kFrozen) device.latched = device.frozen = before;
    device.flags |= flag_of(fault.kind);
  }
}

void Driver::log(std::uint32_t more_flags) noexcept {
  if (!log_ || devices_.empty() || !devices_[0]) return;
  const Device& device = *devices_[0];
  TickRow row;
  row.tick = clock_tick_ - first_tick_;
  row.time = tick_began_;
  give(row.position, device.latched.position);
  Eigen::Map<Eigen::Vector4d>(row.orientation) = device.latched.orientation.coeffs();
  row.buttons = device.latched.buttons;
  row.flags = more_flags | device.flags | (device.force_output ? kForceOutput : 0u) |
              (device.injected_ticks > 0 ? kErrorReported : 0u) | (device.unplugged ? kGone : 0u);
  give(row.commanded, device.commanded_force);
  give(row.motor, device.motor_force);
  log_->add(row);
}

void Driver::finish_tick() {
  bool ended = false;
  for (unsigned i = 0; i < devices_.size(); ++i) {
    if (!devices_[i]) continue;
    Device& device = *devices_[i];
    if (i == 0) ended = device.had_frame && !device.in_frame;
    if (device.in_frame) {
      device.in_frame = false;
      device.commanded_force = device.motor_force = Vec3::Zero();
      if (!device.unplugged) misuse(HD_FRAME_ERROR, i, "a frame was not ended in its tick");
    }
    if (i == 0) log(ended ? kFrameEnded : 0u);
    if (device.injected_ticks > 0) --device.injected_ticks;
  }
}

void Driver::hold_for_a_tick() {
  for (const auto& device : devices_)
    if (device) device->arm.advance(device->held_force, time());
  ++clock_tick_;
}

// After a tick: for those that passed until it was over under the force from before it.
void Driver::move_arms(long passed) {
  for (; passed > 0; --passed) hold_for_a_tick();
  for (const auto& device : devices_)
    if (device) device->held_force = device->motor_force;
  hold_for_a_tick();
}

void Driver::release_motors() {
  for (const auto& device : devices_)
    if (device) device->motor_force = device->held_force = Vec3::Zero();
  log(kMotorsReleased);
}

void Driver::tick() {
  std::array<Scheduled, 16> callbacks;
  {
    const Lock lock(mutex_);
    begin_tick();
    callbacks = scheduled_;
  }
  in_callback = true;
  for (const FaultSettings& fault : settings_.faults)
    if (fault.kind == FaultKind::kHangingTick && begins(fault))
      std::this_thread::sleep_for(
          std::chrono::duration<double>(static_cast<double>(fault.ticks) / settings_.phantom.rate));
  for (const Scheduled& s : callbacks) {
    if (s.handle == 0 || s.callback(s.data) != HD_CALLBACK_DONE) continue;
    const Lock lock(mutex_);
    for (Scheduled& mine : scheduled_)
      if (mine.handle == s.handle) mine = {};
    changed_.notify_all();
  }
  for (;;) {
    Waiting* next = nullptr;
    {
      const Lock lock(mutex_);
      if (!waiting_.empty()) next = waiting_.front();
    }
    if (!next) break;
    next->callback(next->data);
    const Lock lock(mutex_);
    next->done = true;
    waiting_.erase(waiting_.begin());
    changed_.notify_all();
  }
  in_callback = false;
  const Lock lock(mutex_);
  finish_tick();
}

void Driver::run_in_real_time() {
  double start = monotonic_time();
  const double period = settings_.phantom.time_step();
  // The first device's disturbances are the loop's.
  const auto loop = [this]() -> SimulatedArm* {
    return !devices_.empty() && devices_[0] ? &devices_[0]->arm : nullptr;
  };
  while (!leave_) {
    double due = 0;
    {
      const Lock lock(mutex_);
      const long n = clock_tick_ - first_tick_;
      due = start + static_cast<double>(n) * period;
      if (SimulatedArm* const arm = loop()) {
        due += arm->lateness(n);
        if (arm->misses(n)) {
          hold_for_a_tick();
          continue;
        }
      }
    }
    sleep_until(due);
    if (leave_) return;  // no last tick: a program has to command zero force itself
    tick();
    const Lock lock(mutex_);
    const double next = start + static_cast<double>(clock_tick_ + 1 - first_tick_) * period;
    long passed = static_cast<long>((monotonic_time() - next) / period);
    if (passed > kMostCaughtUp) {
      start += static_cast<double>(passed - kMostCaughtUp) * period;
      passed = kMostCaughtUp;
    }
    move_arms(passed);
  }
}

// ---- Beside the interface.

int Driver::configure(const char* toml) {
  const Lock lock(mutex_);
  try {
    if (any_open() || running_)
      throw Error("stand-in: cannot be configured while a device is open or the servo runs");
    settings_ = parse_settings(toml, "stand-in settings");
    motion_of(settings_.hand);
    motion_of(settings_.mirror);
  } catch (const std::exception& e) {
    message_ = e.what();
    return -1;
  }
  configured_ = true;
  errors_.clear();
  misuses_ = 0;
  first_misuse_.clear();
  log_.reset();
  clock_tick_ = first_tick_ = 0;
  devices_.clear();
  closed_.clear();
  scheduled_ = {};
  return 0;
}

const char* Driver::message() { return message_.c_str(); }

long Driver::run(long ticks) {
  {
    const Lock lock(mutex_);
    if (!running_ || !settings_.stepped) return 0;
  }
  for (long i = 0; i < ticks; ++i) {
    bool misses = false;
    {
      const Lock lock(mutex_);
      misses =
          !devices_.empty() && devices_[0] && devices_[0]->arm.misses(clock_tick_ - first_tick_);
      if (misses) hold_for_a_tick();
    }
    if (misses) continue;
    tick();
    const Lock lock(mutex_);
    move_arms(0);
  }
  return ticks;
}

StandInDevice Driver::state_of(const Device& device) {
  StandInDevice state{};
  give(state.commanded_force, device.commanded_force);
  give(state.motor_force, device.motor_force);
  give(state.true_position, device.arm.phantom().true_position());
  state.frames = device.frames;
  state.force_output = device.force_output;
  return state;
}

int Driver::state(unsigned device, StandInDevice& state) {
  const Lock lock(mutex_);
  if (device < devices_.size() && devices_[device]) {
    state = state_of(*devices_[device]);
    return 0;
  }
  if (device >= closed_.size()) return -1;
  state = closed_[device];
  return 0;
}

long Driver::ticks() {
  const Lock lock(mutex_);
  return clock_tick_;
}

long Driver::misuses() {
  const Lock lock(mutex_);
  return misuses_;
}

const char* Driver::first_misuse() {
  const Lock lock(mutex_);
  return first_misuse_.c_str();
}

void Driver::inject(unsigned device, HDerror code, long ticks) {
  const Lock lock(mutex_);
  if (device >= devices_.size() || !devices_[device]) return;
  devices_[device]->asked = code;
  devices_[device]->asked_ticks = ticks;
}

void Driver::unplug(unsigned device) {
  const Lock lock(mutex_);
  if (device < devices_.size() && devices_[device]) unplug(*devices_[device]);
}

void Driver::unplug(Device& device) {
  device.unplugged = true;
  device.motor_force = device.held_force = Vec3::Zero();  // without power
}

}  // namespace toothprep::stand_in
