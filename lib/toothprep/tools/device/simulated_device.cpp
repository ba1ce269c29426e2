#include "toothprep/tools/device/simulated_device.h"

#include <cmath>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/device/tick_clock.h"

namespace toothprep {
namespace {

// More ticks than this can't be made up for at once after a pause of the machine: the clock is set
// anew instead.
constexpr long kMostCaughtUp = 1000;

Disturbances with_seed(Disturbances disturbances, std::uint64_t seed) {
  disturbances.seed = seed;
  return disturbances;
}

}  // namespace

SimulatedDevice::SimulatedDevice(const SimulatedSettings& settings)
    : period_(settings.phantom.time_step()),
      real_time_(settings.real_time),
      arm_(settings.phantom, settings.hand, settings.motion, settings.disturbances),
      servo_(settings.phantom.force_limit, settings.phantom.time_step(), settings.ramp) {
  const Disturbances& d = settings.disturbances;
  if (d.jitter + (d.late_every > 0 ? d.late : 0) >= period_ && !real_time_)
    throw Error("simulated device: ticks later than a period are possible in real time only");
  if (settings.mirror_motion)
    mirror_.emplace(settings.phantom, settings.hand, *settings.mirror_motion,
                    with_seed(d, d.seed + 1));
  identity_ = {"simulated", "simulated Phantom Desktop", "toothprep", "simulated", "", ""};
  mirror_identity_ = identity_;
  mirror_identity_.name = "simulated mirror";
  limits_.rate = settings.phantom.rate;
  limits_.max_force = settings.phantom.force_limit;
  limits_.max_continuous_force = std::min(settings.continuous_force, limits_.max_force);
  limits_.max_stiffness = 1.0;  // of a Phantom Desktop in software practice (CHAI3D)
  limits_.max_damping = 5e-3;   // likewise, and the friction bound of the simulated one
  limits_.workspace = Eigen::AlignedBox3d(Vec3(-80, -60, -60), Vec3(80, 60, 60));
  limits_.has_orientation = true;
}

SimulatedDevice::~SimulatedDevice() { SimulatedDevice::stop(); }

void SimulatedDevice::start(ServoClient& client) {
  if (started_) throw Error("simulated device: runs already; stop it first");
  servo_.open(client);
  first_tick_ = clock_tick_;
  held_force_ = new_force_ = Vec3::Zero();
  leave_ = false;
  started_ = true;
  if (real_time_) thread_ = std::thread([this] { run_in_real_time(); });
}

void SimulatedDevice::stop() noexcept {
  if (!started_) return;
  servo_.ask_to_close();
  if (servo_.in_tick_on_this_thread()) return;
  leave_ = true;
  if (thread_.joinable()) thread_.join();
  // The motors let go, whatever was still on its way to them.
  for (int i = 0; i <= arm_.phantom().model().delay_ticks; ++i) {
    held_force_ = Vec3::Zero();
    hold_for_a_tick();
  }
  servo_.closed();
  started_ = false;
}

void SimulatedDevice::run(long ticks) {
  if (real_time_) throw Error("simulated device: runs in real time; run() is for the other mode");
  if (!started_) throw Error("simulated device: not started");
  for (long i = 0; i < ticks; ++i) {
    const long n = clock_tick_ - first_tick_;
    const double lateness = arm_.lateness(n);
    if (arm_.misses(n)) {
      hold_for_a_tick();
    } else {
      tick(static_cast<double>(n) * period_ + lateness);
      move_arms(0);
    }
  }
}

void SimulatedDevice::inject(DeviceFault fault, long ticks) noexcept {
  injected_ = fault;
  injected_ticks_ = ticks;
}

void SimulatedDevice::run_in_real_time() noexcept {
  const double origin = monotonic_time();
  double start = origin;  // when tick first_tick_ was due
  while (!leave_) {
    const long n = clock_tick_ - first_tick_;
    const double lateness = arm_.lateness(n);
    if (arm_.misses(n)) {
      hold_for_a_tick();
      continue;
    }
    sleep_until(start + static_cast<double>(n) * period_ + lateness);
    tick(monotonic_time() - origin);
    const double due = start + static_cast<double>(clock_tick_ + 1 - first_tick_) * period_;
    long passed = static_cast<long>((monotonic_time() - due) / period_);
    if (passed > kMostCaughtUp) {
      start += static_cast<double>(passed - kMostCaughtUp) * period_;
      passed = kMostCaughtUp;
    }
    move_arms(passed);
  }
}

void SimulatedDevice::tick(double time) noexcept {
  DeviceFault fault = DeviceFault::kNone;
  if (injected_ticks_ > 0) {
    fault = injected_;
    --injected_ticks_;
  }
  const DevicePose hand = arm_.read(arm_time());
  if (mirror_) {
    const DevicePose other = mirror_->read(arm_time());
    new_force_ = servo_.begin_tick(time, hand, &other, fault);
  } else {
    new_force_ = servo_.begin_tick(time, hand, nullptr, fault);
  }
  servo_.end_tick();
}

// For the ticks that passed until it was over under the force from before it.
void SimulatedDevice::move_arms(long passed) noexcept {
  for (; passed > 0; --passed) hold_for_a_tick();
  held_force_ = new_force_;
  hold_for_a_tick();
}

void SimulatedDevice::hold_for_a_tick() noexcept {
  arm_.advance(held_force_, arm_time());
  if (mirror_) mirror_->advance(Vec3::Zero(), arm_time());
  ++clock_tick_;
}

}  // namespace toothprep
