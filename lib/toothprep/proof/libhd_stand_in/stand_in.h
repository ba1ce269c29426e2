// What the stand-in exports beside the vendor's interface, for tests and experiments. Found with
// dlsym under these names in the library that TOOTHPREP_LIBHD names. Devices are counted from 0 in
// the order of their configured names.
#pragma once

extern "C" {

struct StandInDevice {
  double commanded_force[3];  // N, as the last frame gave it; kept when the servo stops
  double motor_force[3];      // N, what the motors hold: zero when forces are off or the servo is
  double true_position[3];    // mm, of the handle
  long frames;                // ended
  int force_output;           // enabled?
};

// Takes the settings from this TOML text (README.md) instead of the environment, and forgets
// errors, counts and devices. Not while a device is open. Returns 0, or -1 with standInMessage().
int standInConfigure(const char* toml);
const char* standInMessage();

// With `stepped = true`, between hdStartScheduler and hdStopScheduler: this many ticks, on the
// caller's thread, as fast as they go. Returns how many were run.
long standInRun(long ticks);

// Of a device that is open, or as it was when it was closed. 0, or -1: never opened.
int standInState(unsigned device, StandInDevice* state);
long standInTicks();  // of the servo's clock, since the last configuration

// What a correct program never does, each also an error of the interface: the count, and
// the first one in words ("" if none).
long standInMisuses();
const char* standInFirstMisuse();

// From the next tick on, for so many ticks.
void standInInject(unsigned device, unsigned error_code, long ticks);
void standInUnplug(unsigned device);
}
