#include "toothprep/proof/figures/experiment.h"

#include <algorithm>
#include <cmath>
#include <filesystem>

#include "toothprep/step/core/strict_toml.h"

namespace toothprep::figures {
namespace {

namespace fs = std::filesystem;

constexpr double kFromPerMetre = 1e-3;  // N·s/m and N/m to N·s/mm and N/mm

const std::vector<std::pair<std::string, Kind>> kKinds = {
    {"plateaus", Kind::kPlateaus},
    {"proportional-to-speed", Kind::kProportionalToSpeed},
    {"proportional-to-area", Kind::kProportionalToArea},
    {"stall", Kind::kStall},
    {"closed-loop", Kind::kClosedLoop},
    {"preparations", Kind::kPreparations},
    {"literal", Kind::kLiteral},
    {"droop", Kind::kDroop},
    {"passes", Kind::kPasses},
    {"ablations", Kind::kAblations},
    {"feasibility", Kind::kFeasibility},
    {"laws", Kind::kLaws},
    {"rotor", Kind::kRotor},
    {"validation", Kind::kValidation},
    {"transparency", Kind::kTransparency}};

std::string beside(const std::string& folder, const std::string& file) {
  return (fs::path(folder) / file).lexically_normal().string();  // an absolute file stays
}

bool is_plain_name(const std::string& name) {
  return !name.empty() && name.size() <= 60 && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '-' ||
           c == '_';
  });
}

void read_block(StrictTable& table, const Experiment& e, BlockOptions& block) {
  auto given = table.table("block");
  if (!given) return;
  if (e.molar) table.refuse("block", "stands beside specimen = \"molar\"");
  if (const auto x = given->vector("size_mm")) block.size = *x;
  if (const auto x = given->number("enamel_mm")) block.enamel = *x;
  given->done();
}

// The keys that a run may have, over what stands at the top.
void read_run(StrictTable& table, const std::string& folder, Run& run) {
  if (const auto x = table.choice("drive", {"coupled", "direct"}))
    run.drive = *x == "direct" ? Drive::kDirect : Drive::kCoupled;
  if (const auto x = table.text("bur")) run.bur = *x;
  if (const auto x = table.text("trajectory")) run.trajectory = beside(folder, *x);
  if (const auto x = table.text("params")) run.params = beside(folder, *x);
  if (const auto x = table.text("literal")) run.literal = beside(folder, *x);
  if (const auto x = table.text("after")) run.after = *x;
}

void require_complete(const StrictTable& table, const Run& run, Kind kind) {
  if (run.bur.empty()) table.missing("bur", "\"cylinder:D1.2xL3.0\"");
  if (run.trajectory.empty()) table.missing("trajectory", "\"path.toml\"");
  if (kind == Kind::kLiteral && run.literal.empty()) table.missing("literal", "\"literal.toml\"");
}

std::vector<double> positive(StrictTable& table, const std::string& key, double unit) {
  std::vector<double> values = table.numbers(key).value_or(std::vector<double>{});
  if (values.empty()) table.missing(key, "[1.0, 10.0]");
  for (double& v : values) {
    if (!(v > 0)) table.refuse(key, "must be positive");
    v *= unit;
  }
  return values;
}

// What a run of kind "ablations" takes out.
void read_ablation(StrictTable& table, Run& run) {
  if (const auto x = table.choice("engine", {"levelset", "voxel"}))
    run.engine = *x == "voxel" ? EngineKind::kVoxel : EngineKind::kLevelset;
  if (const auto x = table.choice("layers", {"two", "met", "inside"}))
    run.ablation.layers = *x == "two" ? Layers::kTwo : *x == "met" ? Layers::kMet : Layers::kInside;
  if (const auto x = table.choice("integrator", {"backward", "semi-implicit", "explicit"}))
    run.ablation.integrator = *x == "backward"   ? Integrator::kBackward
                              : *x == "explicit" ? Integrator::kExplicit
                                                 : Integrator::kSemiImplicit;
  if (const auto x = table.integer("equal_area")) run.ablation.equal_area = static_cast<int>(*x);
  const int kinds = run.ablation.equal_area;
  if (kinds != 0 && kinds != 6 && kinds != 18 && kinds != 26)
    table.refuse("equal_area", "must be 6, 18 or 26, or 0 for the true surface");
  if (kinds != 0 && (run.engine != EngineKind::kVoxel || run.ablation.layers != Layers::kTwo))
    table.refuse("equal_area", "is of engine = \"voxel\" with layers = \"two\" only");
  if (const auto x = table.number("filter_hz")) run.ablation.filter_hz = *x;
  if (!(run.ablation.filter_hz >= 0)) table.refuse("filter_hz", "must not be negative");
  if (run.ablation.layers != Layers::kTwo && run.engine != EngineKind::kVoxel)
    table.refuse("layers", "must be \"two\" with engine = \"levelset\"");
  if (run.ablation.integrator != Integrator::kBackward && run.drive != Drive::kCoupled)
    table.refuse("integrator", "must be \"backward\" in direct drive, which integrates nothing");
  if (run.ablation.filter_hz > 0 && run.drive != Drive::kDirect)
    table.refuse("filter_hz", "is of direct drive only");
}

// The [[run]] tables, over what stands at the top.
void read_runs(StrictTable& root, const std::string& folder, const Run& top, Experiment& e) {
  if (auto tables = root.tables("run")) {
    for (StrictTable& table : *tables) {
      Run run = top;
      const auto name = table.text("name");
      if (!name) table.missing("name", "\"first\"");
      if (!is_plain_name(*name))
        table.refuse("name", "must be letters, digits and hyphens: it names files");
      run.name = *name;
      run.title = table.text("title").value_or(run.name);
      read_run(table, folder, run);
      if (e.kind == Kind::kPreparations && table.has("block"))
        table.refuse("block", "stands at the top, for all runs");
      read_block(table, e, run.block);
      if (e.kind == Kind::kAblations) read_ablation(table, run);
      const auto named = [&](const std::string& other) {
        return std::any_of(e.runs.begin(), e.runs.end(),
                           [&](const Run& r) { return r.name == other; });
      };
      if (named(run.name)) table.refuse("name", "\"" + run.name + "\" stands twice");
      if (!run.after.empty() && !named(run.after))
        table.refuse("after", "\"" + run.after + "\" is no earlier run");
      require_complete(table, run, e.kind);
      table.done();
      e.runs.push_back(run);
    }
  }
}

void read_model(StrictTable& device, PhantomModel& model) {
  if (const auto x = device.number("apparent_mass_g")) model.apparent_mass = units::from_gram(*x);
  if (const auto x = device.number("damping_n_s_per_m")) model.damping = *x * kFromPerMetre;
  if (const auto x = device.number("friction_n")) model.friction = *x;
  if (const auto x = device.number("encoder_count_mm")) model.encoder_count = *x;
  if (const auto x = device.number("force_limit_n")) model.force_limit = *x;
  if (const auto x = device.integer("delay_ticks"))
    model.delay_ticks = static_cast<int>(std::clamp<std::int64_t>(*x, -1, 1000));
}

void read_hand(StrictTable& root, Experiment& e) {
  auto hand = root.table("hand");
  if (!hand) return;
  if (const auto x = hand->number("mass_g")) e.hand.mass = units::from_gram(*x);
  if (const auto x = hand->number("stiffness_n_per_m")) e.hand.stiffness = *x * kFromPerMetre;
  if (const auto x = hand->number("damping_n_s_per_m")) e.hand.damping = *x * kFromPerMetre;
  hand->done();
}

void read_device_and_hand(StrictTable& root, Experiment& e) {
  if (auto device = root.table("device")) {
    read_model(*device, e.device);
    device->done();
  }
  read_hand(root, e);
}

// Of a table: the value stays if it is not given.
void read_positive(StrictTable& table, const char* key, double& value, double unit = 1) {
  if (const auto x = table.number(key)) value = *x * unit;
  if (!(value > 0) || !std::isfinite(value)) table.refuse(key, "must be positive");
}

void read_rendering_device(StrictTable& table, RenderingDevice& d) {
  const auto name = table.text("name");
  if (!name) table.missing("name", "\"desktop\"");
  if (!is_plain_name(*name))
    table.refuse("name", "must be letters, digits and hyphens: it names files");
  d.name = *name;
  d.title = table.text("title").value_or(d.name);
  read_model(table, d.model);
  if (!(d.model.encoder_count > 0)) table.refuse("encoder_count_mm", "must be positive");
  read_positive(table, "stiffness_in_practice_n_per_mm", d.practical_stiffness);
  if (const auto x = table.number("recommended_damping_n_s_per_m"))
    d.recommended_damping = *x * kFromPerMetre;
  if (!(d.recommended_damping >= 0) || !std::isfinite(d.recommended_damping))
    table.refuse("recommended_damping_n_s_per_m", "must not be negative");
  table.done();
}

void read_transparency(StrictTable& root, Transparency& t) {
  auto devices = root.tables("device");
  if (!devices || devices->empty()) root.missing("device", "... tables [[device]]");
  for (StrictTable& table : *devices) {
    t.devices.emplace_back();
    read_rendering_device(table, t.devices.back());
  }
  auto grid = root.table("grid");
  if (!grid) root.missing("grid", "... a table [grid]");
  t.stiffnesses = positive(*grid, "stiffnesses_n_per_mm", 1);
  t.dampings = positive(*grid, "dampings_n_s_per_m", kFromPerMetre);
  t.feeds = positive(*grid, "feeds_mm_s", 1);
  t.frequencies = positive(*grid, "frequencies_hz", 1);
  t.time_steps = positive(*grid, "time_steps_ms", 1e-3);
  for (const double f : t.frequencies)
    if (f != std::round(f)) grid->refuse("frequencies_hz", "must be whole numbers");
  grid->done();
  if (auto ours = root.table("thresholds")) {
    read_positive(*ours, "settled_ms", t.settled_time, 1e-3);
    read_positive(*ours, "settled_percent", t.settled_share, 1e-2);
    read_positive(*ours, "felt_rms_n", t.felt);
    ours->done();
  }
}

void read_feasibility(StrictTable& root, Feasibility& f) {
  auto map = root.table("map");
  if (!map) root.missing("map", "... a table [map]");
  f.rotation_rates = positive(*map, "rotation_rates_rev_s", 1);
  f.stiffnesses = positive(*map, "stiffnesses_n_per_mm", 1);
  f.engaged = positive(*map, "engaged_mm", 1);
  map->done();
  const auto read = [](StrictTable& table, const char* key, double& value) {
    if (const auto x = table.number(key)) value = *x;
    if (!(value > 0) || !std::isfinite(value)) table.refuse(key, "must be positive");
  };
  if (auto stated = root.table("stated")) {
    read(*stated, "stall_torque_mnm", f.stall_torque);
    read(*stated, "stall_speed_mm_s", f.stall_speed);
    read(*stated, "resistance_n_s_per_mm", f.resistance);
    read(*stated, "direct_limit_n_s_per_mm", f.direct_limit);
    stated->done();
  }
  if (auto ours = root.table("thresholds")) {
    read(*ours, "stall_speed_percent", f.stall_speed_percent);
    read(*ours, "resistance_percent", f.resistance_percent);
    read(*ours, "peak_percent", f.peak_percent);
    ours->done();
  }
}

}  // namespace

Experiment read_experiment(const std::string& folder) {
  const std::string file = (fs::path(folder) / "experiment.toml").string();
  const toml::table document = parse_toml(read_small_text(file), file);
  StrictTable root(document, file);
  Experiment e;
  e.name = fs::path(folder).lexically_normal().filename().string();
  if (!is_plain_name(e.name))
    throw InputError(folder, "", "the folder's name must be letters, digits and hyphens");
  e.title = root.text("title").value_or(e.name);

  std::vector<std::string> kinds;
  for (const auto& [name, kind] : kKinds) kinds.push_back(name);
  const auto kind = root.choice("kind", kinds);
  if (!kind) root.missing("kind", "\"plateaus\"");
  for (const auto& [name, value] : kKinds)
    if (name == *kind) e.kind = value;

  if (e.kind == Kind::kValidation) {
    const auto measurements = root.text("measurements");
    if (!measurements) root.missing("measurements", "\"../../validation\"");
    e.measurements = beside(folder, *measurements);
    root.done();
    return e;
  }
  e.molar = root.choice("specimen", {"block", "molar"}).value_or("block") == "molar";
  Run top;
  top.name = "run";
  top.title = e.title;
  if (e.kind == Kind::kTransparency) {
    read_transparency(root, e.transparency);
    read_hand(root, e);
  } else {
    read_block(root, e, top.block);
    read_device_and_hand(root, e);
  }
  try {
    validate(e.device);
    validate(e.hand);
    for (const RenderingDevice& d : e.transparency.devices) validate(d.model);
  } catch (const InputError&) {
    throw;
  } catch (const Error& error) {
    throw InputError(file, "", error.what());
  }
  if (e.kind == Kind::kTransparency) {  // paths and blocks are its own
    if (const auto x = root.text("bur")) top.bur = *x;
    if (top.bur.empty()) root.missing("bur", "\"cylinder:D1.2xL3.0\"");
    if (const auto x = root.text("params")) top.params = beside(folder, *x);
    root.done();
    e.runs.push_back(top);
    return e;
  }
  if (e.kind == Kind::kFeasibility) {
    read_feasibility(root, e.feasibility);
  } else if (auto map = root.table("map")) {
    e.map.dampings = positive(*map, "dampings_n_s_per_m", kFromPerMetre);
    e.map.masses = positive(*map, "apparent_masses_g", units::from_gram(1));
    e.map.stiffnesses = positive(*map, "stiffnesses_n_per_mm", 1);
    map->done();
  } else if (e.kind == Kind::kClosedLoop) {
    root.missing("map", "... a table [map]");
  }

  read_run(root, folder, top);
  read_runs(root, folder, top, e);
  if (e.runs.empty()) {
    require_complete(root, top, e.kind);
    e.runs.push_back(top);
  }
  root.done();
  return e;
}

std::vector<std::string> find_experiments(const std::string& folder,
                                          const std::vector<std::string>& only) {
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (fs::exists(entry.path() / "experiment.toml"))
      names.push_back(entry.path().filename().string());
  if (error) throw InputError(folder, "", "cannot be read as a folder of experiments");
  std::sort(names.begin(), names.end());
  if (names.empty())
    throw InputError(folder, "", "holds no folder with an experiment.toml",
                     "give the folder that holds the experiments' folders");
  const auto matches = [](const std::string& name, const std::string& choice) {
    if (name == choice) return true;
    // "9" is the number of figure-09.
    if (choice.empty() || choice.find_first_not_of("0123456789") != std::string::npos) return false;
    const std::size_t digits = name.find_first_of("0123456789");
    if (digits == std::string::npos || name.rfind("figure-", 0) != 0) return false;
    const std::size_t value = name.find_first_not_of('0', digits);
    return value != std::string::npos && name.substr(value) == choice;
  };
  std::vector<std::string> chosen;
  for (const std::string& name : names)
    if (only.empty() || std::any_of(only.begin(), only.end(),
                                    [&](const std::string& o) { return matches(name, o); }))
      chosen.push_back((fs::path(folder) / name).string());
  for (const std::string& o : only)
    if (std::none_of(names.begin(), names.end(),
                     [&](const std::string& name) { return matches(name, o); })) {
      std::string list;
      for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
      throw Error("no experiment is named \"" + o + "\" (there are: " + list + ")");
    }
  return chosen;
}

Parameters parameters_of(const Run& run, const Parameters& base, bool literal) {
  Parameters p = base;
  if (!run.params.empty()) p = read_parameters(run.params, p);
  if (literal) p = read_parameters(run.literal, p);
  return p;
}

}  // namespace toothprep::figures
