// The binary interface of the vendor's device library (libHD, OpenHaptics 3.0 and newer) on x86-64
// Linux, in our own words: the types, calls and numbers that this toolkit uses. No header of the
// vendor's is needed or contained. Traps that cost others a day are marked (!).
//
// Functions have C linkage and the ordinary C calling convention. All but those that take a handle
// act on the *current* device. State is read and set inside a frame.
#pragma once

namespace toothprep::hdapi {

using HDenum = unsigned int;
using HDerror = unsigned int;
using HHD = unsigned int;  // a device's handle
using HDboolean = unsigned char;
using HDulong = unsigned long;
using HDSchedulerHandle = unsigned long;  // (!) 64 bits; an int cuts it off
using HDushort = unsigned short;
using HDstring = const char*;  // static, never freed
using HDSchedulerCallback = unsigned int (*)(void* user_data);

// (!) Returned by value, in two registers.
struct HDErrorInfo {
  HDerror errorCode;
  int internalErrorCode;
  HHD hHD;
};
static_assert(sizeof(HDErrorInfo) == 12 && sizeof(HDSchedulerHandle) == 8,
              "this interface is that of 64-bit Linux");

constexpr HHD HD_INVALID_HANDLE = 0xFFFFFFFF;  // (!) not to be confused with HD_BAD_HANDLE
constexpr HDstring HD_DEFAULT_DEVICE = nullptr;
constexpr unsigned int HD_CALLBACK_DONE = 0, HD_CALLBACK_CONTINUE = 1;
constexpr HDushort HD_MIN_SCHEDULER_PRIORITY = 0, HD_DEFAULT_SCHEDULER_PRIORITY = 32767,
                   HD_MAX_SCHEDULER_PRIORITY = 65535;
constexpr HDenum HD_WAIT_CHECK_STATUS = 0, HD_WAIT_INFINITE = 1;

// Errors: of a call, of forces, of the device, of frames and scheduling.
constexpr HDerror HD_SUCCESS = 0x0000;
constexpr HDerror HD_INVALID_ENUM = 0x0100, HD_INVALID_VALUE = 0x0101,
                  HD_INVALID_OPERATION = 0x0102, HD_INVALID_INPUT_TYPE = 0x0103,
                  HD_BAD_HANDLE = 0x0104;
constexpr HDerror HD_WARM_MOTORS = 0x0200, HD_EXCEEDED_MAX_FORCE = 0x0201,
                  HD_EXCEEDED_MAX_FORCE_IMPULSE = 0x0202, HD_EXCEEDED_MAX_VELOCITY = 0x0203,
                  HD_FORCE_ERROR = 0x0204;
constexpr HDerror HD_DEVICE_FAULT = 0x0300, HD_DEVICE_ALREADY_INITIATED = 0x0301,
                  HD_COMM_ERROR = 0x0302, HD_COMM_CONFIG_ERROR = 0x0303, HD_TIMER_ERROR = 0x0304;
constexpr HDerror HD_ILLEGAL_BEGIN = 0x0400, HD_ILLEGAL_END = 0x0401, HD_FRAME_ERROR = 0x0402;
constexpr HDerror HD_INVALID_PRIORITY = 0x0500, HD_SCHEDULER_FULL = 0x0501,
                  HD_INVALID_LICENSE = 0x0600;

// State, of the frame. Type and count of each in brackets.
constexpr HDenum HD_CURRENT_BUTTONS = 0x2000,  // int[1], bits
    HD_CURRENT_SAFETY_SWITCH = 0x2001,         // boolean[1] (!) refused as any other type
    HD_CURRENT_INKWELL_SWITCH = 0x2002,        // boolean[1]
    HD_CURRENT_ENCODER_VALUES = 0x2010,        // long[6]
    HD_CURRENT_POSITION = 0x2050,              // double[3], mm
    HD_CURRENT_VELOCITY = 0x2051,              // double[3], mm/s, smoothed by the driver
    HD_CURRENT_TRANSFORM = 0x2052,             // double[16] (!) column-major, translation in 12..14
    HD_CURRENT_FORCE = 0x2700;                 // double[3], N

// Identity.
constexpr HDenum HD_VERSION = 0x2500, HD_DEVICE_MODEL_TYPE = 0x2501,
                 HD_DEVICE_DRIVER_VERSION = 0x2502, HD_DEVICE_VENDOR = 0x2503,
                 HD_DEVICE_SERIAL_NUMBER = 0x2504,  // strings
    HD_DEVICE_FIRMWARE_VERSION = 0x2505;            // double[1]

// Hardware, rates and limits.
constexpr HDenum HD_MAX_WORKSPACE_DIMENSIONS = 0x2550,  // double[6]: min x, y, z, max x, y, z, mm
    HD_USABLE_WORKSPACE_DIMENSIONS = 0x2551,            // double[6]
    HD_INPUT_DOF = 0x2553, HD_OUTPUT_DOF = 0x2554,      // int[1]
    HD_CALIBRATION_STYLE = 0x2555,                      // int[1], bits
    HD_UPDATE_RATE = 0x2600,                   // int[1], Hz (!) some programs read it as double
    HD_INSTANTANEOUS_UPDATE_RATE = 0x2601,     // int[1], Hz
    HD_NOMINAL_MAX_STIFFNESS = 0x2602,         // double[1], N/mm
    HD_NOMINAL_MAX_FORCE = 0x2603,             // double[1], N
    HD_NOMINAL_MAX_CONTINUOUS_FORCE = 0x2604,  // double[1], N
    HD_MOTOR_TEMPERATURE = 0x2605,             // double[6]
    HD_NOMINAL_MAX_DAMPING = 0x2609;           // double[1], N·s/mm (!) out of order

// Capabilities.
constexpr HDenum HD_FORCE_OUTPUT = 0x4000, HD_MAX_FORCE_CLAMPING = 0x4001,
                 HD_FORCE_RAMPING = 0x4002, HD_SOFTWARE_FORCE_LIMIT = 0x4003,
                 HD_ONE_FRAME_LIMIT = 0x4004;

// Calibration: status, and styles as bits.
constexpr HDenum HD_CALIBRATION_OK = 0x5000, HD_CALIBRATION_NEEDS_UPDATE = 0x5001,
                 HD_CALIBRATION_NEEDS_MANUAL_INPUT = 0x5002;
constexpr HDenum HD_CALIBRATION_ENCODER_RESET = 1, HD_CALIBRATION_AUTO = 2,
                 HD_CALIBRATION_INKWELL = 4;

// Every function of the interface: X(result, name, parameters).
#define TOOTHPREP_HDAPI_FUNCTIONS(X)                                              \
  X(HHD, hdInitDevice, (HDstring name))                                           \
  X(void, hdDisableDevice, (HHD device))                                          \
  X(void, hdMakeCurrentDevice, (HHD device))                                      \
  X(HHD, hdGetCurrentDevice, ())                                                  \
  X(void, hdBeginFrame, (HHD device))                                             \
  X(void, hdEndFrame, (HHD device))                                               \
  X(void, hdEnable, (HDenum capability))                                          \
  X(void, hdDisable, (HDenum capability))                                         \
  X(HDboolean, hdIsEnabled, (HDenum capability))                                  \
  X(void, hdGetBooleanv, (HDenum what, HDboolean * values))                       \
  X(void, hdGetIntegerv, (HDenum what, int* values))                              \
  X(void, hdGetFloatv, (HDenum what, float* values))                              \
  X(void, hdGetDoublev, (HDenum what, double* values))                            \
  X(void, hdGetLongv, (HDenum what, long* values))                                \
  X(HDstring, hdGetString, (HDenum what))                                         \
  X(void, hdSetBooleanv, (HDenum what, const HDboolean* values))                  \
  X(void, hdSetIntegerv, (HDenum what, const int* values))                        \
  X(void, hdSetFloatv, (HDenum what, const float* values))                        \
  X(void, hdSetDoublev, (HDenum what, const double* values))                      \
  X(void, hdSetLongv, (HDenum what, const long* values))                          \
  X(HDErrorInfo, hdGetError, ())                                                  \
  X(HDstring, hdGetErrorString, (HDerror code))                                   \
  X(HDenum, hdCheckCalibration, ())                                               \
  X(HDenum, hdCheckCalibrationStyle, ())                                          \
  X(void, hdUpdateCalibration, (HDenum style))                                    \
  X(void, hdStartScheduler, ())                                                   \
  X(void, hdStopScheduler, ())                                                    \
  X(void, hdSetSchedulerRate, (HDulong hz))                                       \
  X(HDSchedulerHandle, hdScheduleAsynchronous,                                    \
    (HDSchedulerCallback callback, void* user_data, HDushort priority))           \
  X(void, hdScheduleSynchronous,                                                  \
    (HDSchedulerCallback callback, void* user_data, HDushort priority))           \
  X(void, hdUnschedule, (HDSchedulerHandle handle))                               \
  X(HDboolean, hdWaitForCompletion, (HDSchedulerHandle handle, HDenum wait_code)) \
  X(double, hdGetSchedulerTimeStamp, ())

}  // namespace toothprep::hdapi
