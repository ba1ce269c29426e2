// Work that takes long: without the GIL, on a thread of its own, while the calling thread looks for
// Ctrl-C and reports progress to Python.
#pragma once

#include <pybind11/pybind11.h>

#include <condition_variable>
#include <functional>
#include <mutex>
#include <string>

namespace toothprep::python {

class Progress {
 public:
  // Called by the work now and then, from any of its threads. Throws what ends the work once the
  // user has pressed Ctrl-C or the callback has raised.
  void report(const std::string& stage, double done);

 private:
  friend void run_long(const pybind11::object& callback,
                       const std::function<void(Progress&)>& work);
  std::mutex mutex_;
  std::condition_variable ended_now_;
  std::string stage_;
  double done_ = 0;
  bool news_ = false, cancelled_ = false, ended_ = false;
};

// Runs `work`, which must not touch a Python object, and rethrows what it throws. `callback` is None
// or is called as callback(stage, done), done from 0 to 1, by the calling thread. When it raises, or
// at Ctrl-C, the work is ended at its next report, and the exception goes to the caller.
void run_long(const pybind11::object& callback, const std::function<void(Progress&)>& work);

}  // namespace toothprep::python
