#include "session_options.h"

#include <fmt/format.h>

#include <algorithm>
#include <iostream>

#include "numeric_options.h"
#include "toothprep/step/bur/bur_library.h"
#include "toothprep/step/core/errors.h"

namespace toothprep::app {
namespace {

constexpr double kMostLoad = 1000;  // N: beyond, the load is in another unit

void add_load_options(CLI::App& sub, SessionOptions& o) {
  sub.add_option("--load-n", o.load,
                 "Force X,Y,Z on the bur in N for --drive load, over the trajectory's own")
      ->delimiter(',')
      ->expected(3);
  sub.add_option("--rail", o.rail,
                 "With --drive load the bur slides along this direction X,Y,Z alone, as on a sled")
      ->delimiter(',')
      ->expected(3);
}

}  // namespace

void add_session_options(CLI::App& sub, SessionOptions& o, bool takes_load) {
  sub.add_option("--tooth", o.tooth, "Layered tooth (.vdb), required");
  sub.add_option("--bur", o.bur,
                 "cylinder:D1.2xL3.0, ball:D1.2, a name of the library, or a profile file; 'list' "
                 "prints the library");
  std::vector<std::string> drives = {"coupled", "direct"};
  if (takes_load) drives.emplace_back("load");
  sub.add_option("--drive", o.drive,
                 std::string("coupled: by the virtual spring; direct: imposed motion") +
                     (takes_load ? "; load: imposed force" : ""))
      ->check(CLI::IsMember(drives))
      ->capture_default_str();
  if (takes_load) add_load_options(sub, o);
  sub.add_option("--engine", o.engine, "levelset or voxel (default: the parameters')")
      ->check(CLI::IsMember({"levelset", "voxel"}));
  sub.add_option("--params", o.params, "Parameter file (.toml; format in data/parameters)");
  sub.add_option("--preset", o.preset, "paper (default) or physical, under the parameter file")
      ->check(CLI::IsMember(std::vector<std::string>(std::begin(kPresets), std::end(kPresets))));
  sub.add_option("--stiffness-n-per-mm", o.stiffness, "Coupling stiffness, over the file's");
  sub.add_option("--damping-n-s-per-mm", o.damping, "Coupling damping, over the file's");
  sub.add_option("--rotation-rate-rev-s", o.rotation_rate, "Rotation rate N, over the file's");
  or_infinity(sub.add_option("--stall-torque-mnm", o.stall_torque,
                             "Stall torque (inf: none), over the file's"));
  sub.add_option("--time-step-s", o.time_step, "Step, over the file's");
}

void put_load(const SessionOptions& o, const std::string& file, Trajectory& path) {
  if (!o.load.empty()) {
    for (HandleSample& s : path.samples) s.load = Vec3(o.load[0], o.load[1], o.load[2]);
  } else if (!path.loaded) {
    throw InputError(file, "", "holds no load, which --drive load needs",
                     "give --load-n X,Y,Z, the columns load_x_N,load_y_N,load_z_N, or the dataset "
                     "/force/applied");
  }
  double most = 0;
  for (std::size_t i = 0; i < path.samples.size(); ++i) {
    const double load = path.samples[i].load.norm();
    if (!(load <= kMostLoad))
      throw InputError(file, fmt::format("sample {}", i),
                       fmt::format("the load of {:.4g} N is above {:g} N", load, kMostLoad),
                       "is it in another unit? loads are in N");
    most = std::max(most, load);
  }
  if (most == 0)
    throw InputError(file, "", "the load is zero throughout: nothing would move the bur");
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
  if (o.rail == std::vector<double>(3)) throw Error("--rail: 0,0,0 has no direction");
  if (!o.rail.empty()) p.load.rail = {o.rail[0], o.rail[1], o.rail[2]};
  validate(p);
  return p;
}

Drive drive_of(const SessionOptions& o) { return drive_named(o.drive).value_or(Drive::kCoupled); }

Interventions interventions_of(const SessionEvents& events, const Bur& bur,
                               const std::string& source) {
  Interventions all;
  all.source = source;
  all.events = events.events;
  if (all.events.empty()) return all;
  for (const std::string& text : events.burs)
    all.burs.push_back(all.burs.empty() ? bur : make_bur(text, data_folder() + "/burs"));
  return all;
}

void print_bur_library() {
  for (const LibraryEntry& entry : list_library(data_folder() + "/burs"))
    std::cout << fmt::format("{:<16} {:<38} {}\n", entry.name, entry.shape, entry.description);
  std::cerr << "Dimensions in mm; where each comes from stands in " << data_folder()
            << "/burs/library.toml\n";
}

}  // namespace toothprep::app
