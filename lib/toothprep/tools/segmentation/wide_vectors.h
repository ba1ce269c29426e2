// Loops that the compiler turns into vector instructions, as wide as the processor has them.
#pragma once

namespace toothprep {

#if defined(__x86_64__) && defined(__GNUC__)
// With all that it calls. No fused multiply-add is among AVX2's instructions: the same bits.
template <class Work>
__attribute__((target("avx2"), flatten)) void with_avx2(const Work& work) {
  work();
}
#endif

// False: as on a processor without them, for a test of the same results.
inline bool wide_vectors_allowed = true;

// work(): twice as many numbers an instruction where the processor can, with the same results.
template <class Work>
void with_wide_vectors(const Work& work) {
#if defined(__x86_64__) && defined(__GNUC__)
  if (wide_vectors_allowed && __builtin_cpu_supports("avx2")) return with_avx2(work);
#endif
  work();
}

}  // namespace toothprep
