// The interface itself: every function of the vendor's library that toothprep (hdapi.h) or other
// programs commonly use, and the stand-in's own (stand_in.h). All of it is a hand-over to Driver.
#include <algorithm>

#include "driver.h"
#include "stand_in.h"

using namespace toothprep::hdapi;
using toothprep::stand_in::Driver;
using toothprep::stand_in::Type;

namespace {

// Never destroyed: a servo thread may outlive the program's statics.
Driver& driver() {
  static Driver& only = *new Driver;
  return only;
}

template <class Value>
void get(HDenum what, Type type, Value* values) {
  double given[16];
  const int count = driver().get(what, type, given);
  std::transform(given, given + count, values, [](double v) { return static_cast<Value>(v); });
}

template <class Value>
void set(HDenum what, Type type, const Value* values) {
  // Only a force can be set, and it has three components; of other types nothing is read.
  double three[3] = {};
  if (type == Type::kReal && what == HD_CURRENT_FORCE) std::copy(values, values + 3, three);
  driver().set(what, type, three);
}

}  // namespace

// The declarations check the definitions below against the interface.
extern "C" {
#pragma GCC visibility push(default)
#define TOOTHPREP_DECLARE(result, name, parameters) result name parameters;
TOOTHPREP_HDAPI_FUNCTIONS(TOOTHPREP_DECLARE)
#undef TOOTHPREP_DECLARE

HHD hdInitDevice(HDstring name) { return driver().init(name); }
void hdDisableDevice(HHD device) { driver().disable_device(device); }
void hdMakeCurrentDevice(HHD device) { driver().make_current(device); }
HHD hdGetCurrentDevice() { return driver().current(); }
void hdBeginFrame(HHD device) { driver().begin_frame(device); }
void hdEndFrame(HHD device) { driver().end_frame(device); }
void hdEnable(HDenum capability) { driver().set_capability(capability, true); }
void hdDisable(HDenum capability) { driver().set_capability(capability, false); }
HDboolean hdIsEnabled(HDenum capability) { return driver().is_enabled(capability); }
void hdGetBooleanv(HDenum what, HDboolean* values) { get(what, Type::kBoolean, values); }
void hdGetIntegerv(HDenum what, int* values) { get(what, Type::kInteger, values); }
void hdGetFloatv(HDenum what, float* values) { get(what, Type::kReal, values); }
void hdGetDoublev(HDenum what, double* values) { get(what, Type::kReal, values); }
void hdGetLongv(HDenum what, long* values) { get(what, Type::kLong, values); }
HDstring hdGetString(HDenum what) { return driver().text(what); }
void hdSetBooleanv(HDenum what, const HDboolean* values) { set(what, Type::kBoolean, values); }
void hdSetIntegerv(HDenum what, const int* values) { set(what, Type::kInteger, values); }
void hdSetFloatv(HDenum what, const float* values) { set(what, Type::kReal, values); }
void hdSetDoublev(HDenum what, const double* values) { set(what, Type::kReal, values); }
void hdSetLongv(HDenum what, const long* values) { set(what, Type::kLong, values); }
HDErrorInfo hdGetError() { return driver().pop_error(); }
HDstring hdGetErrorString(HDerror code) { return driver().error_text(code); }
HDenum hdCheckCalibration() { return driver().check_calibration(); }
HDenum hdCheckCalibrationStyle() { return driver().calibration_style(); }
void hdUpdateCalibration(HDenum style) { driver().update_calibration(style); }
void hdUpdateCalibrationMessage(HDenum) {}
void hdStartScheduler() { driver().start(); }
void hdStopScheduler() { driver().stop(); }
void hdSetSchedulerRate(HDulong hz) { driver().set_rate(hz); }
HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback callback, void* user_data,
                                         HDushort priority) {
  return driver().schedule(callback, user_data, priority);
}
void hdScheduleSynchronous(HDSchedulerCallback callback, void* user_data, HDushort) {
  driver().schedule_and_wait(callback, user_data);
}
void hdUnschedule(HDSchedulerHandle handle) { driver().unschedule(handle); }
HDboolean hdWaitForCompletion(HDSchedulerHandle handle, HDenum wait_code) {
  return driver().wait(handle, wait_code);
}
double hdGetSchedulerTimeStamp() { return driver().time_in_tick(); }
HDboolean hdDeploymentLicense(const char*, const char*) { return 1; }

int standInConfigure(const char* toml) { return driver().configure(toml); }
const char* standInMessage() { return driver().message(); }
long standInRun(long ticks) { return driver().run(ticks); }
int standInState(unsigned device, StandInDevice* state) { return driver().state(device, *state); }
long standInTicks() { return driver().ticks(); }
long standInMisuses() { return driver().misuses(); }
const char* standInFirstMisuse() { return driver().first_misuse(); }
void standInInject(unsigned device, unsigned error_code, long ticks) {
  driver().inject(device, error_code, ticks);
}
void standInUnplug(unsigned device) { driver().unplug(device); }
#pragma GCC visibility pop
}
