#include "toothprep/live/live_watch.h"

#include <chrono>
#include <thread>

#include "toothprep/core/errors.h"

namespace toothprep {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kLook = std::chrono::milliseconds(5);
constexpr double kTellEvery = 0.25;  // s

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Zero force on every way out.
struct Stop {
  HapticDevice& device;
  ~Stop() { device.stop(); }
};

class Watcher {
 public:
  Watcher(HapticDevice& device, const LiveWatch& watch) : device_(device), watch_(watch) {}

  bool asked(LiveEnd& end) const {
    if (!watch_.stop_asked || !watch_.stop_asked()) return false;
    end.reason = "asked to stop";
    return true;
  }

  bool device_failed(LiveEnd& end) const {
    end.device = device_.status();
    if (end.device.state == ServoState::kFaulted)
      end.reason = describe(end.device.last_fault);
    else if (end.device.ticks > 0 && end.device.age > watch_.stale)
      end.reason = "the device's servo loop hangs: no tick came for " +
                   std::to_string(static_cast<int>(1000 * end.device.age)) + " ms";
    else
      return false;
    end.fault = true;
    return true;
  }

  // Until something ends it.
  void watch_over(const std::function<LiveStatus()>& status, LiveEnd& end) const {
    const auto began = Clock::now();
    double told = -kTellEvery;
    for (;;) {
      const double now = seconds_since(began);
      if (device_failed(end) || asked(end)) return;
      if (status().vibrates) {
        end.reason =
            "the loop of hand and force vibrates: it is unstable, and the force was switched off";
        end.fault = true;
        return;
      }
      if (watch_.duration > 0 && now >= watch_.duration) {
        end.reason = "duration";
        return;
      }
      if (watch_.tell && now - told >= kTellEvery) {
        told = now;
        watch_.tell(status(), end.device);
      }
      std::this_thread::sleep_for(kLook);
    }
  }

 private:
  HapticDevice& device_;
  const LiveWatch& watch_;
};

}  // namespace

LiveEnd run_live(HapticDevice& device, LiveLoop& loop, const Registration& registration,
                 const std::optional<Vec3>& start, double time_step,
                 const std::function<Session&(const Pose&)>& make_session, const LiveWatch& watch) {
  const Stop stop{device};
  const Watcher watcher(device, watch);
  LiveEnd end;
  device.start(loop);
  const auto started = Clock::now();
  while (!loop.first_pose()) {
    if (watcher.device_failed(end) || watcher.asked(end)) return end;
    if (seconds_since(started) > watch.first_pose_wait)
      throw Error("the device runs but gives no position");
    std::this_thread::sleep_for(kLook);
  }
  const DevicePose first = *loop.first_pose();
  const HandleFrame frame(registration, first.position, start.value_or(Vec3::Zero()));
  Session& session = make_session(frame.to_world(first.position, first.orientation));
  loop.begin(session, frame, registration, start, time_step);
  watcher.watch_over([&] { return loop.status(); }, end);
  device.stop();
  end.device = device.status();
  loop.finish();
  return end;
}

LiveEnd run_probe(HapticDevice& device, ProbeLoop& loop, const LiveWatch& watch) {
  const Stop stop{device};
  const Watcher watcher(device, watch);
  LiveEnd end;
  device.start(loop);
  watcher.watch_over([&] { return loop.status(); }, end);
  device.stop();
  end.device = device.status();
  return end;
}

}  // namespace toothprep
