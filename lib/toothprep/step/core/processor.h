// For code that is compiled for several processors and chosen when the program is loaded. Internal.
#pragma once

// Into the kernel of each processor.
#if defined(__GNUC__)
#define TOOTHPREP_INLINE inline __attribute__((always_inline))
#else
#define TOOTHPREP_INLINE inline
#endif

namespace toothprep {

// Whether a kernel compiled for AVX2 may run here.
inline bool has_avx2() {
#if defined(__x86_64__) && defined(__GNUC__)
  __builtin_cpu_init();  // this may run before main()
  return __builtin_cpu_supports("avx2");
#else
  return false;
#endif
}

}  // namespace toothprep
