// For -include ahead of everything: the packaged ITK's headers know only the compiler that they were
// packaged with, so clang is presented to them as GCC.
#ifdef __clang__
#if __has_include(<itk_compiler_detection.h>)
#pragma push_macro("__clang__")
#pragma push_macro("__GNUC__")
#undef __clang__
#undef __GNUC__
#define __GNUC__ 12
#include <itk_compiler_detection.h>
#pragma pop_macro("__GNUC__")
#pragma pop_macro("__clang__")
#endif
#endif
