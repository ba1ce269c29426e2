// A reader of foreign files under test: any bytes give what they describe or an Error, never more.
// Each fuzz_*.cpp of this folder registers one. libfuzzer_main.cpp feeds it what libFuzzer thinks
// up (scripts/fuzz), test_corpus.cpp the files of corpus/ (the ordinary test suite).
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace toothprep::fuzz {

struct Target {
  std::string name;  // of its folder in corpus/ and of its seeds
  // What the file is called; of several the input's first byte chooses. Beside it stands
  // beside.raw: 4096 bytes of 7.
  std::vector<std::string> file_names;
  void (*read)(const std::string& path);
};

// Those of this program, in no particular order.
inline std::vector<Target>& targets() {
  static std::vector<Target> all;
  return all;
}

struct Registered {
  explicit Registered(Target target) { targets().push_back(std::move(target)); }
};

// Reads the bytes as a file. True if they were taken, false if they were refused by an Error;
// anything else leaves as it came.
bool read_bytes(const Target& target, const std::uint8_t* data, std::size_t size);

// For what must hold of anything that was read: stops the program.
inline void require(bool condition) {
  if (!condition) __builtin_trap();
}

}  // namespace toothprep::fuzz
