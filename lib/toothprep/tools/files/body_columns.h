// /contact/body_area: the advancing contact by bodies, in traces of teeth that have several.
#pragma once

#include <string>
#include <vector>

#include "toothprep/step/core/step_record.h"
#include "toothprep/step/tooth/tooth_bodies.h"

namespace toothprep {

constexpr const char* kBodyAreaName = "/contact/body_area";  // of the dataset, in mm^2
constexpr const char* kBodyNames = "bodies";  // of its attribute, and the root's list

[[nodiscard]] std::vector<std::string> names_of(const std::vector<Body>& list);

// A row's values, one for each body of the list; the prepared tooth's is what the others leave of
// the contact.
void get_body_areas(const StepRecord& row, const std::vector<Body>& list, double* values);
void set_body_areas(StepRecord& row, const std::vector<Body>& list, const double* values);

}  // namespace toothprep
