// How a file is read that may be damaged or meant to do harm.
//
// HDF5 (1.10 at least) and OpenVDB trust what they find: a damaged file can make them crash, loop or
// take gigabytes. A child process can be the one that it happens to.
#pragma once

namespace toothprep {

enum class ReadPolicy {  // how a foreign file is read
  // A child process (fork) reads the file first, with limits on time and memory, and only what came
  // through there is read here: whatever the file holds, the answer is the content or an
  // InputError. Every HDF5 file takes twice the time (0.3 s more for 240,000 rows); a tooth that
  // this toolkit wrote proves by its checksum that it is whole, and needs no child. The child gets
  // this process's memory as it is and none of its threads: no other thread may hold a lock that
  // the libraries take, and TBB's worker threads end before it is made.
  kTrial,
  // Read here at once; no process is made. For a program with threads of its own (a simulator's
  // servo and graphics loops), and files whose origin it trusts. What the readers check themselves
  // is an InputError all the same, but a damaged file may end the program.
  kDirect
};

}  // namespace toothprep
