#include "session_options.h"

#include <fmt/format.h>

#include <iostream>

#include "numeric_options.h"
#include "toothprep/step/bur/bur_library.h"

namespace toothprep::app {

void add_session_options(CLI::App& sub, SessionOptions& o) {
  sub.add_option("--tooth", o.tooth, "Layered tooth (.vdb), required");
  sub.add_option("--bur", o.bur,
                 "cylinder:D1.2xL3.0, ball:D1.2, a name of the library, or a profile file; 'list' "
                 "prints the library");
  sub.add_option("--drive", o.drive, "coupled: by the virtual spring; direct: imposed motion")
      ->check(CLI::IsMember({"coupled", "direct"}))
      ->capture_default_str();
  sub.add_option("--engine", o.engine, "levelset or voxel (default: the parameters')")
      ->check(CLI::IsMember({"levelset", "voxel"}));
  sub.add_option("--params", o.params, "Parameter file (.toml; format in data/parameters)");
  sub.add_option("--preset", o.preset, "paper (default) or physical, under the parameter file")
      ->check(CLI::IsMember({"paper", "physical"}));
  sub.add_option("--stiffness-n-per-mm", o.stiffness, "Coupling stiffness, over the file's");
  sub.add_option("--damping-n-s-per-mm", o.damping, "Coupling damping, over the file's");
  sub.add_option("--rotation-rate-rev-s", o.rotation_rate, "Rotation rate N, over the file's");
  or_infinity(sub.add_option("--stall-torque-mnm", o.stall_torque,
                             "Stall torque (inf: none), over the file's"));
  sub.add_option("--time-step-s", o.time_step, "Step, over the file's");
}

Parameters load_parameters(const SessionOptions& o) {
  const std::string preset = o.preset.empty() ? "paper" : o.preset;
  Parameters p = o.params.empty() ? preset_parameters(preset) : read_parameters(o.params, preset);
  if (!o.engine.empty())
    p.engine = o.engine == "voxel" ? EngineKind::kVoxel : EngineKind::kLevelset;
  if (o.stiffness) p.coupling.stiffness = *o.stiffness;
  if (o.damping) p.coupling.damping = *o.damping;
  if (o.rotation_rate) p.handpiece.rotation_rate = *o.rotation_rate;
  if (o.stall_torque) p.handpiece.stall_torque = *o.stall_torque;
  if (o.time_step) p.time_step = *o.time_step;
  validate(p);
  return p;
}

Drive drive_of(const SessionOptions& o) {
  return o.drive == "direct" ? Drive::kDirect : Drive::kCoupled;
}

void print_bur_library() {
  for (const LibraryEntry& entry : list_library(data_folder() + "/burs"))
    std::cout << fmt::format("{:<16} {:<38} {}\n", entry.name, entry.shape, entry.description);
  std::cerr << "Dimensions in mm; where each comes from stands in " << data_folder()
            << "/burs/library.toml\n";
}

}  // namespace toothprep::app
