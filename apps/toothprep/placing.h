// A path put on a tooth: the options, the placing, and what there is to say of a path on a tooth
// before anything is cut.
#pragma once

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "command.h"
#include "toothprep/step/bur/bur.h"
#include "toothprep/tools/placement/own_frame.h"
#include "toothprep/tools/placement/path_check.h"
#include "toothprep/tools/trajectory/path_frame.h"

namespace toothprep::app {

struct PlacingOptions {
  std::string from;  // "tooth", or another tooth's file
  std::string at, registration;
  std::optional<double> turn_deg;
  bool any() const { return !from.empty() || !at.empty() || !registration.empty() || turn_deg; }
};

// `from_option`: the name of the option that says in which frame the path is written.
void add_placing_options(CLI::App& sub, PlacingOptions& options, const std::string& from_option);

// The recorded frame of a tooth; where it has none, or no fossa, by its form.
ToothFrame frame_of(const LayeredTooth& tooth);
// The same; landmarks of --at count before what the tooth's file knows.
ToothFrame frame_of(const LayeredTooth& tooth, const PlacingOptions& options);

struct PlacedPath {
  Trajectory path;                 // W of the tooth
  std::string how;                 // a line for the user
  std::vector<std::string> notes;  // warnings
};
// `frame`: what the file itself says of it. Throws Error for options that don't say enough.
PlacedPath place_path(Trajectory path, PathFrame frame, const std::string& file,
                      const PlacingOptions& options, const LayeredTooth& tooth);

// The frame whose z is occlusal, whatever else is known, for check_path().
Pose upright_frame(const ToothFrame& frame, const LayeredTooth& tooth);

// The figures of a path on a tooth: for JSON, and as lines for people.
nlohmann::ordered_json path_json(const PathCheck& check, const LayeredTooth& whole);
std::vector<std::string> path_lines(const PathCheck& check, const LayeredTooth& whole);
// What a user ought to know before it is cut: the path doesn't touch the tooth, begins in it, opens
// the pulp, brings the shank into the tooth.
std::vector<std::string> path_warnings(const PathCheck& check, const LayeredTooth& whole);

// The path in the tooth (.png): from the occlusal, and in two sections through its deepest place.
void write_path_picture(const LayeredTooth& tooth, const ToothFrame& frame, const Bur& bur,
                        const Trajectory& path, const PathCheck& check, const std::string& file);

}  // namespace toothprep::app
