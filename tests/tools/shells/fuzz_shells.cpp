// A libFuzzer target: the reader of shells on any bytes gives a shell or an error, never more; what
// it gives can be judged and repaired. The first byte chooses the format. Built and run by
// scripts/fuzz.
#include <unistd.h>

#include <array>
#include <cstdint>
#include <cstdio>
#include <string>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/shells/shells.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  constexpr std::array<const char*, 4> kExtensions = {".stl", ".ply", ".obj", ".off"};
  if (size < 1) return 0;
  const std::string path = "/dev/shm/fuzz-shells-" + std::to_string(getpid()) +
                           kExtensions[data[0] % kExtensions.size()];
  std::FILE* file = std::fopen(path.c_str(), "wb");
  if (!file) return 0;
  std::fwrite(data + 1, 1, size - 1, file);
  std::fclose(file);
  try {
    toothprep::Shell shell = toothprep::read_shell(path);
    if (shell.triangles.size() <= 64) {  // CGAL takes its time
      toothprep::shell_faults(shell);
      toothprep::repair_shell(shell);
      toothprep::shell_faults(shell);
    }
  } catch (const toothprep::InputError&) {
  }
  std::remove(path.c_str());
  return 0;
}
