// Counts allocations by whatever way: malloc, calloc, realloc and the aligned ones, hence operator
// new, Eigen and growing pools too. It takes the place of glibc's functions: for a program of its
// own, included once, and not with the sanitizers, which bring their own.
#pragma once

#include <atomic>
#include <cerrno>
#include <cstddef>

namespace toothprep::testing {
inline std::atomic<long> allocations = 0;       // of all threads
inline thread_local long allocations_here = 0;  // of the calling thread
}  // namespace toothprep::testing

extern "C" {
void* __libc_malloc(std::size_t size);
void* __libc_calloc(std::size_t count, std::size_t size);
void* __libc_realloc(void* p, std::size_t size);
void* __libc_memalign(std::size_t alignment, std::size_t size);

static void count_one() {
  toothprep::testing::allocations.fetch_add(1, std::memory_order_relaxed);
  ++toothprep::testing::allocations_here;
}
void* malloc(std::size_t size) noexcept {
  count_one();
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) noexcept {
  count_one();
  return __libc_calloc(count, size);
}
void* realloc(void* p, std::size_t size) noexcept {
  count_one();
  return __libc_realloc(p, size);
}
void* memalign(std::size_t alignment, std::size_t size) noexcept {
  count_one();
  return __libc_memalign(alignment, size);
}
void* aligned_alloc(std::size_t alignment, std::size_t size) noexcept {
  return memalign(alignment, size);
}
int posix_memalign(void** p, std::size_t alignment, std::size_t size) noexcept {
  *p = memalign(alignment, size);
  return *p ? 0 : ENOMEM;
}
}
