// The stand-in's inside: devices, an error stack and a servo loop, strict about how they are used.
// Every public function may be called from any thread.
#pragma once

#include <array>
#include <atomic>
#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "settings.h"
#include "stand_in.h"
#include "tick_log.h"
#include "toothprep/tools/device/simulated_arm.h"

namespace toothprep::stand_in {

enum class Type { kBoolean, kInteger, kReal, kLong, kString };

class Driver {
 public:
  Driver();
  ~Driver();

  // Devices and frames.
  hdapi::HHD init(const char* name);
  void disable_device(hdapi::HHD handle);
  void make_current(hdapi::HHD handle);
  hdapi::HHD current();
  void begin_frame(hdapi::HHD handle);
  void end_frame(hdapi::HHD handle);

  // Values, at most 16 of them. Returns how many were given; 0 after an error.
  int get(hdapi::HDenum what, Type type, double* values);
  const char* text(hdapi::HDenum what);
  void set(hdapi::HDenum what, Type type, const double* three);
  void set_capability(hdapi::HDenum capability, bool enabled);
  bool is_enabled(hdapi::HDenum capability);

  hdapi::HDErrorInfo pop_error();
  const char* error_text(hdapi::HDerror code);

  hdapi::HDenum check_calibration();
  hdapi::HDenum calibration_style();
  void update_calibration(hdapi::HDenum style);

  // Scheduler.
  void start();
  void stop();
  void set_rate(unsigned long hz);
  hdapi::HDSchedulerHandle schedule(hdapi::HDSchedulerCallback callback, void* data,
                                    hdapi::HDushort priority);
  void schedule_and_wait(hdapi::HDSchedulerCallback callback, void* data);
  void unschedule(hdapi::HDSchedulerHandle handle);
  bool wait(hdapi::HDSchedulerHandle handle, hdapi::HDenum code);
  double time_in_tick();

  // Beside the interface.
  int configure(const char* toml);
  const char* message();
  long run(long ticks);
  int state(unsigned device, StandInDevice& state);
  long ticks();
  long misuses();
  const char* first_misuse();
  void inject(unsigned device, hdapi::HDerror code, long ticks);
  void unplug(unsigned device);

 private:
  struct Device {
    explicit Device(SimulatedArm simulated) : arm(std::move(simulated)) {}

    SimulatedArm arm;
    DevicePose latched;             // at the tick's start
    DevicePose frozen;              // what a frozen device goes on reading
    Vec3 set_force = Vec3::Zero();  // in this frame
    Vec3 commanded_force = Vec3::Zero(), motor_force = Vec3::Zero();
    Vec3 held_force = Vec3::Zero();            // by the motors while the tick lasts
    bool in_frame = false, had_frame = false;  // in this tick
    bool force_output = false, clamping = true, ramping = true, force_limit = true,
         one_frame = true;
    bool unplugged = false;
    hdapi::HDenum calibration = hdapi::HD_CALIBRATION_OK;
    hdapi::HDerror asked = hdapi::HD_SUCCESS, injected = hdapi::HD_SUCCESS;
    long asked_ticks = 0, injected_ticks = 0;  // from the next tick on; and in this one
    long frames = 0;
    std::uint32_t flags = 0;  // TickFlag, of this tick
  };
  struct Scheduled {
    hdapi::HDSchedulerHandle handle = 0;  // 0: free
    hdapi::HDSchedulerCallback callback = nullptr;
    void* data = nullptr;
    int priority = 0;
  };
  struct Waiting {
    hdapi::HDSchedulerCallback callback;
    void* data;
    bool done = false;
  };
  using Lock = std::unique_lock<std::mutex>;

  hdapi::HHD open(const char* name);
  void start_servo();

  // All with the lock held.
  void push_error(hdapi::HDerror code, hdapi::HHD handle, int internal = 0);
  void misuse(hdapi::HDerror code, hdapi::HHD handle, const char* what);
  Device* device_of(hdapi::HHD handle);
  Device* current_device(const char* caller);
  bool any_open() const;
  void create(unsigned index);
  void begin_tick();
  void disturb(unsigned index, Device& device);
  void log(std::uint32_t more_flags) noexcept;
  bool begins(const FaultSettings& fault) const;
  bool lasts(const FaultSettings& fault) const;
  bool lasts(FaultKind kind, hdapi::HHD device) const;
  void hang_if(FaultKind kind) const;
  void finish_tick();
  void hold_for_a_tick();
  void move_arms(long passed);
  void release_motors();
  static void unplug(Device& device);
  static StandInDevice state_of(const Device& device);
  double time() const { return static_cast<double>(clock_tick_) / settings_.phantom.rate; }

  void tick();  // takes the lock where it needs it
  void run_in_real_time();

  std::mutex mutex_;
  std::condition_variable changed_;
  Settings settings_;
  bool configured_ = false;
  std::string message_, fault_text_ = "device fault", first_misuse_;
  long misuses_ = 0;
  std::vector<std::unique_ptr<Device>> devices_;  // by index; handle = index
  std::vector<StandInDevice> closed_;             // by index, as they were when closed
  hdapi::HHD current_ = hdapi::HD_INVALID_HANDLE;
  std::vector<hdapi::HDErrorInfo> errors_;
  std::array<Scheduled, 16> scheduled_;
  hdapi::HDSchedulerHandle next_handle_;
  std::vector<Waiting*> waiting_;
  bool running_ = false;
  std::atomic<bool> leave_ = false;
  long clock_tick_ = 0;                   // of the arms, since the configuration
  long first_tick_ = 0;                   // clock_tick_ at the start of the servo
  long last_tick_ = -1, this_tick_ = -1;  // of the servo, that came
  double tick_began_ = 0;
  std::unique_ptr<TickLog> log_;
  std::thread thread_;
};

}  // namespace toothprep::stand_in
