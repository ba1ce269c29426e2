// [sweep] of a manifest: a design, and the steps that run at its points.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <vector>

#include "toothprep/tools/batch/arguments.h"
#include "toothprep/tools/batch/design.h"
#include "toothprep/tools/batch/manifest.h"

namespace toothprep {

struct SweepStep {
  std::string name, place;
  std::size_t command = 0;
  BatchArguments arguments;
  std::vector<std::string> fill;   // options whose file is filled in
  std::vector<std::string> after;  // items or steps
  BatchKeep keep = BatchKeep::kAll;
};

struct Sweep {
  Design design;
  std::size_t repeat = 1;
  std::vector<SweepStep> steps;
};

// What the manifest's reader does for a sweep.
struct SweepHelp {
  std::function<std::optional<std::size_t>(StrictTable&)> command;    // of a step's table
  std::function<std::vector<std::string>(const std::string&)> files;  // that match a pattern
  std::function<bool(std::size_t, const std::string&)> knows;         // command, option
  const BatchArguments* defaults = nullptr;
};

// Throws InputError.
Sweep read_sweep(const toml::table& node, StrictTable& table, const SweepHelp& help);
// "all", "trace" or "score"; absent: all.
BatchKeep read_keep(StrictTable& table);

// One item to be: the step at the values that it depends on, itself or through what it needs.
struct SweepItem {
  std::size_t step = 0;
  std::string name;
  std::vector<std::string> values;          // by factor, empty where it makes no difference
  std::map<std::string, std::size_t> from;  // by the step's name: index of the sweep item it uses
};

struct SweepPlan {
  std::vector<Factor> factors;   // with "repeat"
  std::vector<SweepItem> items;  // what is needed stands before what needs it
  std::size_t points = 0;
};

// `texts`: of each step, the texts that are filled in. Each item once, however many points need it.
SweepPlan plan_sweep(const Sweep& sweep, const std::vector<std::vector<std::string>>& texts,
                     const std::string& where);

}  // namespace toothprep
