// How the program's heap, jemalloc's, is set: it lies on huge pages where the system has them. A fault for each page of
// 4 KiB takes longer than what many commands do with a page. Nothing else depends on it.
extern "C" {
extern const char* malloc_conf;  // the name under which jemalloc looks for it
const char* malloc_conf = "thp:always,metadata_thp:always";
}
