#include "fuzz_target.h"
#include "toothprep/step/core/parameters.h"

namespace toothprep {
namespace {

// What is taken is written as text that is read back as the same text.
void read_and_write(const std::string& path) {
  const std::string text = to_toml(read_parameters(path));
  fuzz::require(to_toml(parse_parameters(text, path)) == text);
}

const fuzz::Registered k_parameters({"parameters", {"rig.toml"}, read_and_write});

}  // namespace
}  // namespace toothprep
