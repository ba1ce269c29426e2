// Bodies on the command line of voxelize: whose labels, whose meshes.
#pragma once

#include <CLI/CLI.hpp>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "toothprep/step/core/tissue.h"
#include "toothprep/step/tooth/tooth_bodies.h"
#include "toothprep/tools/segmentation/voxelize_file.h"

namespace toothprep::app {

// --body, after --labels and --tooth.
void add_body_option(CLI::App& sub, std::vector<std::string>& texts);

// Of --body NAME[:KIND]=VALUE[,VALUE...], one text each; `tissues` are those of --labels. The kind is
// gum for a body of `other` only, else neighbour, unless it is given; values that no text names are
// the prepared tooth's, "tooth", unless a body is given as that. Empty without texts. Throws
// CLI::ValidationError.
std::vector<BodyLabels> parse_body_labels(const std::vector<std::string>& texts,
                                          const std::map<std::uint16_t, Tissue>& tissues);

// --neighbour, after --tooth and --body.
void add_neighbour_option(CLI::App& sub, std::vector<std::string>& texts);

// "NAME=N" or "NAME=X,Y,Z" (mm), one text each. Throws CLI::ValidationError, also if two have one name
// or one is named as the prepared tooth is, "tooth".
std::vector<NeighbourChoice> parse_neighbours(const std::vector<std::string>& texts);

// "N" or "X,Y,Z" (mm), to `tooth` or `tooth_at`. Throws CLI::ValidationError that names the option.
void parse_tooth(const std::string& text, const char* option, int& tooth,
                 std::optional<Vec3>& tooth_at);

// Meshes, [NAME[:KIND]/]TISSUE=FILE each, by body. Those without a name are the prepared tooth's.
struct BodyMeshes {
  std::vector<Body> list;
  std::vector<std::vector<std::pair<Tissue, std::string>>> parts;  // of each
};
BodyMeshes parse_body_meshes(const std::vector<std::string>& texts);

}  // namespace toothprep::app
