#include "toothprep/tools/files/body_columns.h"

#include <algorithm>

namespace toothprep {

std::vector<std::string> names_of(const std::vector<Body>& list) {
  std::vector<std::string> names;
  for (const Body& body : list) names.push_back(body.name);
  return names;
}

void get_body_areas(const StepRecord& row, const std::vector<Body>& list, double* values) {
  std::fill_n(values, list.size(), 0.0);
  double rest = 0;
  for (const double area : row.contact_area) rest += area;
  for (const BodyArea& other : row.other_bodies) {
    if (other.body == 0 || other.body > list.size()) continue;
    values[other.body - 1u] = other.area;
    rest -= other.area;
  }
  for (std::size_t b = 0; b < list.size(); ++b)
    if (list[b].kind == BodyKind::kTooth) values[b] = std::max(rest, 0.0);
}

void set_body_areas(StepRecord& row, const std::vector<Body>& list, const double* values) {
  auto& others = row.other_bodies;
  others = {};
  for (std::size_t b = 0; b < list.size(); ++b) {
    if (list[b].kind == BodyKind::kTooth || !(values[b] > others.back().area)) continue;
    others.back() = {static_cast<std::uint8_t>(b + 1), values[b]};
    for (std::size_t k = others.size() - 1; k > 0 && others[k].area > others[k - 1].area; --k)
      std::swap(others[k], others[k - 1]);
  }
}

}  // namespace toothprep
