// Where tissues part in Hounsfield units, for kinds of scans: a file of presets, each with its
// source.
#pragma once

#include <string>
#include <vector>

namespace toothprep {

struct HounsfieldPreset {
  std::string name, description, source;
  double pulp_dentin = 0, dentin_enamel = 0;  // HU, the borders
};

// Throws InputError for what is not such a file (TOML, [[preset]] tables).
std::vector<HounsfieldPreset> read_hounsfield_presets(const std::string& path);

// Throws Error for a name that is not there, with the nearest one.
const HounsfieldPreset& preset_named(const std::vector<HounsfieldPreset>& presets,
                                     const std::string& name);

}  // namespace toothprep
