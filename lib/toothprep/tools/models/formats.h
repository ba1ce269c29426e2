// A model's file as bytes, in each format.
#pragma once

#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/mesh/surface.h"

namespace toothprep {

class ModelTooLarge : public Error {  // for the format
 public:
  using Error::Error;
};

[[nodiscard]] std::string glb_of(const TriangleMesh& mesh);       // throws ModelTooLarge
[[nodiscard]] std::string three_mf_of(const TriangleMesh& mesh);  // throws Error

}  // namespace toothprep
