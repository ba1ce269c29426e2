#include "toothprep/tools/live/live_watch.h"

#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <cstring>
#include <thread>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/live/last_resort.h"
#include "toothprep/tools/live/probe_loop.h"

namespace toothprep {
namespace {

using Clock = std::chrono::steady_clock;
constexpr auto kLook = std::chrono::milliseconds(5);
constexpr double kReportEvery = 0.25;  // s
constexpr double kLongestFade = 0.2;   // s

double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

// Of SCHED_FIFO's 1 to 99. Above the kernel's threads for interrupts, which run at 50 where it has
// them (PREEMPT_RT, threadirqs): a servo that waited for its device without sleeping would keep
// these from running; drivers sleep. Below the kernel's own for moving tasks and its watchdog, 99.
constexpr int kPriority = 80;

// The servo's thread may be the driver's, so its priority is asked for from within the first tick.
class RealTimeClient final : public ServoClient {
 public:
  RealTimeClient(ServoClient& inner, bool wanted) : inner_(inner), asked_(!wanted) {}

  Vec3 tick(const DeviceReading& reading) override {
    if (!asked_) {
      asked_ = true;
      sched_param parameter{};
      parameter.sched_priority = kPriority;
      const int error = pthread_setschedparam(pthread_self(), SCHED_FIFO, &parameter);
      answer_.store(error, std::memory_order_release);
    }
    return inner_.tick(reading);
  }

  // Empty until it is known; -1 stands for that.
  std::string scheduling() const {
    const int answer = answer_.load(std::memory_order_acquire);
    if (answer < 0) return {};
    if (answer == 0)
      return "servo at real-time priority (SCHED_FIFO " + std::to_string(kPriority) + ")";
    return std::string("servo at normal priority: SCHED_FIFO was refused (") +
           std::strerror(answer) +
           "); give the user real-time rights (rtprio in /etc/security/limits.d)";
  }

 private:
  ServoClient& inner_;
  bool asked_;
  std::atomic<int> answer_ = -1;
};

// Pages that are not there when a tick needs them cost milliseconds.
std::string locked_memory() {
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  // With a limit, locking what comes later would make allocations fail.
  const int what = limit.rlim_cur == RLIM_INFINITY ? MCL_CURRENT | MCL_FUTURE : MCL_CURRENT;
  if (mlockall(what) == 0) return "memory locked";
  return std::string("memory not locked (") + std::strerror(errno) +
         "); raise memlock in /etc/security/limits.d";
}

// Whether the terminal has let the program go on before it stopped: nobody would do so again. The
// system forgets a SIGCONT when the next SIGTSTP comes, so that none can be an old one; seen only
// where it is held back (apps/toothprep/live.cpp).
bool is_continued() {
  sigset_t pending;
  return sigpending(&pending) == 0 && sigismember(&pending, SIGCONT) == 1;
}

// Zero force on every way out.
struct Stop {
  HapticDevice& device;
  ~Stop() { device.stop(); }
};

// Returns once the force is zero, or can't become it.
template <class Loop>
void ramp_out(Loop& loop) {
  loop.fade_out(true);
  const auto from = Clock::now();
  while (!loop.status().faded && seconds_since(from) < kLongestFade)
    std::this_thread::sleep_for(kLook / 5);
}

void stop_device(HapticDevice& device, LiveEnd& end) {
  device.stop();
  end.device = device.status();
  if (end.fault || end.device.state != ServoState::kFaulted) return;
  end.fault = true;
  end.reason = describe(end.device.last_fault);
}

class Watcher {
 public:
  Watcher(HapticDevice& device, const LiveWatch& watch) : device_(device), watch_(watch) {}

  bool asked(LiveEnd& end) const {
    if (watch_.stop_asked && watch_.stop_asked())
      end.reason = "asked to stop";
    else if (watch_.attend)
      end.reason = watch_.attend();
    return !end.reason.empty();
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

  void note(const std::string& line) const {
    if (watch_.note) watch_.note(line);
  }

  // A line when something begins.
  void note_onsets(const LiveStatus& now) {
    if (now.rejections != rejections_) {  // it may be over already
      note(std::string(describe(now.last_fault)) + ": zero force and no cutting until it is right");
      rejects_ = true;
    }
    if (now.reading == ReadingFault::kNone && rejects_) {
      note("the readings are good again: the force is ramped in");
      rejects_ = false;
    }
    rejections_ = now.rejections;
    const DeviceStatus device = device_.status();
    if (device.faults > faults_ && severity_of(device.last_fault) == FaultSeverity::kTransient)
      note(describe(device.last_fault));
    faults_ = device.faults;
    if (now.locked && !locked_)
      note(
          "the motor waits for a safe start: release the pedal, or keep the bur clear of the "
          "tooth for half a second");
    locked_ = now.locked;
    if (now.times_let_go != times_let_go_) {  // it may be over already
      note("nobody holds the stylus, by its safety switch: no force, and the bur stands");
      let_go_ = true;
    }
    if (!now.let_go && let_go_) {
      note("the stylus is held again: the force is ramped in");
      let_go_ = false;
    }
    times_let_go_ = now.times_let_go;
  }

  // Stops the program as the terminal asks it to, without a force on the hand.
  template <class Loop>
  void pause(Loop& loop) const {
    ramp_out(loop);
    note("paused: no force until the program goes on");
    const auto from = Clock::now();
    if (!is_continued()) raise(SIGSTOP);
    char text[80];
    std::snprintf(text, sizeof text, "goes on after %.1f s: the force is ramped in",
                  seconds_since(from));
    note(text);
    loop.fade_out(false);
  }

  // Until something ends it.
  template <class Loop>
  void watch_over(const RealTimeClient& client, Loop& loop, LiveEnd& end) {
    const auto began = Clock::now();
    double reported = -kReportEvery;
    bool scheduling_told = !watch_.real_time || !watch_.report_scheduling;
    for (;;) {
      const double now = seconds_since(began);
      if (!scheduling_told && !client.scheduling().empty()) {
        scheduling_told = true;
        watch_.report_scheduling(client.scheduling());
      }
      if (device_failed(end) || asked(end)) return;
      if (watch_.pause_asked && watch_.pause_asked()) pause(loop);
      const LiveStatus live = loop.status();
      note_onsets(live);
      if (live.hand_lost) {
        end.reason = describe(live.reading);
        end.fault = true;
        return;
      }
      if (live.vibrates) {
        end.reason =
            "the loop of hand and force vibrates: it is unstable, and the force was switched off";
        end.fault = true;
        return;
      }
      if (watch_.duration > 0 && now >= watch_.duration) {
        end.reason = "duration";
        return;
      }
      if (watch_.report && now - reported >= kReportEvery) {
        reported = now;
        watch_.report(live, end.device);
      }
      std::this_thread::sleep_for(kLook);
    }
  }

 private:
  HapticDevice& device_;
  const LiveWatch& watch_;
  bool rejects_ = false;
  std::int64_t rejections_ = 0, faults_ = 0, times_let_go_ = 0;
  bool locked_ = false, let_go_ = false;
};

}  // namespace

LiveEnd run_live(HapticDevice& device, LiveLoop& loop, const Registration& registration,
                 const std::optional<Vec3>& start, double time_step,
                 const std::function<Session*(const Pose&)>& make_session, const LiveWatch& watch) {
  Watcher watcher(device, watch);
  LiveEnd end;
  RealTimeClient client(loop, watch.real_time);
  const Stop stop{device};
  const LastResort last_resort(device);
  if (watch.real_time && watch.report_scheduling) watch.report_scheduling(locked_memory());
  device.start(client);
  const auto started = Clock::now();
  Session* session = nullptr;
  std::optional<HandleFrame> frame;
  while (session == nullptr) {
    if (watcher.device_failed(end) || watcher.asked(end)) return end;
    if (watch.pause_asked && watch.pause_asked()) watcher.pause(loop);
    watcher.note_onsets(loop.status());
    if (const auto hand = loop.waiting_pose()) {
      frame.emplace(registration, hand->position, start.value_or(Vec3::Zero()));
      session = make_session(frame->to_world(hand->position, hand->orientation));
      if (session != nullptr) break;
    } else if (seconds_since(started) > watch.first_pose_wait) {
      throw Error("the device runs but gives no position");
    }
    if (watch.duration > 0 && seconds_since(started) > watch.duration) {
      end.reason = "duration";
      return end;
    }
    std::this_thread::sleep_for(kLook);
  }
  loop.begin(*session, *frame, registration, start, time_step);
  watcher.watch_over(client, loop, end);
  if (!end.fault) ramp_out(loop);
  stop_device(device, end);
  loop.finish();
  return end;
}

LiveEnd run_probe(HapticDevice& device, ProbeLoop& loop, const LiveWatch& watch) {
  Watcher watcher(device, watch);
  LiveEnd end;
  RealTimeClient client(loop, watch.real_time);
  const Stop stop{device};
  const LastResort last_resort(device);
  if (watch.real_time && watch.report_scheduling) watch.report_scheduling(locked_memory());
  device.start(client);
  watcher.watch_over(client, loop, end);
  if (!end.fault) ramp_out(loop);
  stop_device(device, end);
  return end;
}

}  // namespace toothprep
