// libFuzzer's entry points for the one target of this program.
#include <sys/mman.h>

#include <cstring>
#include <vector>

#include "fuzz_target.h"

// The counters that the compiler puts at every edge of the code.
extern "C" std::uint8_t __start___sancov_cntrs[];
extern "C" std::uint8_t __stop___sancov_cntrs[];

namespace {

// Several readers parse in a child process first (io/trial.h). Its counters are the child's own and
// lost with it, unless they stand in shared memory: libFuzzer then sees what an input reached there.
// The pages at both ends hold other data too and stay as they are.
void share_counters_with_children() {
  constexpr std::uintptr_t kPage = 4096;
  const auto begin =
      (reinterpret_cast<std::uintptr_t>(__start___sancov_cntrs) + kPage - 1) / kPage * kPage;
  const auto end = reinterpret_cast<std::uintptr_t>(__stop___sancov_cntrs) / kPage * kPage;
  if (end <= begin) return;
  const std::vector<std::uint8_t> before(reinterpret_cast<std::uint8_t*>(begin),
                                         reinterpret_cast<std::uint8_t*>(end));
  void* shared = mmap(reinterpret_cast<void*>(begin), end - begin, PROT_READ | PROT_WRITE,
                      MAP_SHARED | MAP_ANONYMOUS | MAP_FIXED, -1, 0);
  toothprep::fuzz::require(shared != MAP_FAILED);
  std::memcpy(shared, before.data(), before.size());
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int*, char***) {
  share_counters_with_children();
  return 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  toothprep::fuzz::read_bytes(toothprep::fuzz::targets().front(), data, size);
  return 0;
}
