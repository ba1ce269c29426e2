// The program's large blocks of memory lie on huge pages where the system has them: a page fault for
// each 4 KiB takes longer than what many commands do with what they read. Nothing else depends on it.
#ifndef TOOTHPREP_SANITIZED  // sanitizers have their own
#include <sys/mman.h>

#include <cstdlib>
#include <new>

namespace {

constexpr std::size_t kHugePage = std::size_t{1} << 21;  // bytes, of x86-64 and most of ARM
constexpr std::size_t kLarge = 2 * kHugePage;

void* find_block(std::size_t size) noexcept {
  if (size < kLarge) return std::malloc(size > 0 ? size : 1);
  void* block = nullptr;
  if (posix_memalign(&block, kHugePage, size) != 0) return nullptr;
  madvise(block, size, MADV_HUGEPAGE);  // where it fails the pages are small
  return block;
}

}  // namespace

void* operator new(std::size_t size) {
  while (true) {
    if (void* block = find_block(size)) return block;
    const std::new_handler make_room = std::get_new_handler();
    if (!make_room) throw std::bad_alloc();
    make_room();
  }
}
void operator delete(void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t) noexcept { std::free(block); }
#endif
