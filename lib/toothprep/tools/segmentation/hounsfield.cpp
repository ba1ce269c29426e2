#include "toothprep/tools/segmentation/hounsfield.h"

#include "toothprep/step/core/errors.h"
#include "toothprep/step/core/nearest_name.h"
#include "toothprep/step/core/strict_toml.h"

namespace toothprep {

std::vector<HounsfieldPreset> read_hounsfield_presets(const std::string& path) {
  const toml::table root = parse_toml(read_small_text(path), path);
  StrictTable file(root, path);
  auto tables = file.tables("preset");
  file.done();
  std::vector<HounsfieldPreset> presets;
  for (StrictTable& table : tables ? *tables : std::vector<StrictTable>()) {
    HounsfieldPreset preset;
    const auto text = [&](const char* key) {
      const auto value = table.text(key);
      if (!value || value->empty()) table.missing(key, "\"...\"");
      return *value;
    };
    const auto border = [&](const char* key) {
      const auto value = table.number(key);
      if (!value) table.missing(key, "1000");
      if (!(*value > -1000 && *value < 10000))
        table.refuse(key, "must be a number of Hounsfield units between -1000 and 10000");
      return *value;
    };
    preset.name = text("name");
    preset.description = text("description");
    preset.source = text("source");
    preset.pulp_dentin = border("pulp_dentin");
    preset.dentin_enamel = border("dentin_enamel");
    if (!(preset.pulp_dentin < preset.dentin_enamel))
      table.refuse("dentin_enamel", "must be above pulp_dentin");
    table.done();
    presets.push_back(preset);
  }
  return presets;
}

const HounsfieldPreset& preset_named(const std::vector<HounsfieldPreset>& presets,
                                     const std::string& name) {
  std::vector<std::string> names;
  for (const HounsfieldPreset& preset : presets) {
    if (preset.name == name) return preset;
    names.push_back(preset.name);
  }
  const std::string nearest = nearest_name(name, names);
  throw Error("--hounsfield: there is no preset '" + name + "'" +
              (nearest.empty() ? "" : "; the nearest is '" + nearest + "'") +
              " ('list' prints them)");
}

}  // namespace toothprep
