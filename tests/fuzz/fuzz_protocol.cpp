#include <fstream>
#include <iterator>

#include "fuzz_target.h"
#include "toothprep/tools/rig_check/protocol.h"

namespace toothprep {
namespace {

// What is understood is printed, and understood again as the same.
void parse_and_print(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  const Protocol protocol = parse_protocol({std::istreambuf_iterator<char>(in), {}});
  fuzz::require(parse_protocol(print_protocol(protocol)) == protocol);
}

const fuzz::Registered k_protocol({"protocol", {"protocol.txt"}, parse_and_print});

}  // namespace
}  // namespace toothprep
