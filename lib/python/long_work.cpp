#include "long_work.h"

#include <chrono>
#include <exception>
#include <optional>
#include <thread>

namespace toothprep::python {
namespace {

namespace py = pybind11;

constexpr auto kPoll = std::chrono::milliseconds(50);

struct Cancelled {};

}  // namespace

void Progress::report(const std::string& stage, double done) {
  const std::lock_guard lock(mutex_);
  if (cancelled_) throw Cancelled();
  stage_ = stage;
  done_ = done;
  news_ = true;
}

void run_long(const py::object& callback, const std::function<void(Progress&)>& work) {
  Progress progress;
  std::exception_ptr failure;
  std::thread worker([&] {
    try {
      work(progress);
    } catch (...) {
      failure = std::current_exception();
    }
    const std::lock_guard lock(progress.mutex_);
    progress.ended_ = true;
    progress.ended_now_.notify_all();
  });

  std::optional<py::error_already_set> interruption;
  for (bool ended = false; !ended;) {
    std::string stage;
    double done = 0;
    bool news = false;
    {
      const py::gil_scoped_release released;
      std::unique_lock lock(progress.mutex_);
      ended = progress.ended_now_.wait_for(lock, kPoll, [&] { return progress.ended_; });
      news = std::exchange(progress.news_, false);
      stage = progress.stage_;
      done = progress.done_;
    }
    if (interruption) continue;
    try {
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
      if (news && !callback.is_none()) callback(stage, done);
    } catch (py::error_already_set& raised) {
      interruption.emplace(raised);
      const std::lock_guard lock(progress.mutex_);
      progress.cancelled_ = true;
    }
  }
  worker.join();
  if (interruption) throw std::move(*interruption);
  if (failure) std::rethrow_exception(failure);
}

}  // namespace toothprep::python
