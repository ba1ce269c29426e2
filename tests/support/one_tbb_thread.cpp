// For ThreadSanitizer: oneTBB's library isn't instrumented, so every end of a parallel loop would look like a race. Tests
// linked with this file run such loops in the calling thread; the threads of a session stay.
#include <tbb/global_control.h>

namespace {

const tbb::global_control one_thread(tbb::global_control::max_allowed_parallelism, 1);

}  // namespace
