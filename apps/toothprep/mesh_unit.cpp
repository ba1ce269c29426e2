#include "mesh_unit.h"

#include "toothprep/tools/shells/shells.h"

namespace toothprep::app {

void add_mesh_unit(CLI::App& sub, std::string& unit) {
  std::vector<std::string> names;
  for (const MeshUnit& known : mesh_units()) names.emplace_back(known.name);
  sub.add_option("--length-unit", unit, "Of meshes' coordinates (absent: mm)")
      ->check(CLI::IsMember(names));
}

std::optional<double> mm_per_mesh_unit(const std::string& unit) {
  for (const MeshUnit& known : mesh_units())
    if (unit == known.name) return known.mm;
  return {};
}

}  // namespace toothprep::app
