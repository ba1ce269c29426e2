#include "progress_line.h"

#include <fmt/format.h>
#include <unistd.h>

#include <iostream>

namespace toothprep::app {

ProgressLine::ProgressLine(const Common& common)
    : terminal_(!common.quiet && isatty(STDERR_FILENO) != 0) {}

ProgressLine::~ProgressLine() { erase(); }

std::function<void(const std::string&, double)> ProgressLine::report() {
  if (!terminal_) return {};
  return [this](const std::string& stage, double done) { write(stage, done); };
}

void ProgressLine::write(const std::string& stage, double done) {
  const std::lock_guard lock(mutex_);
  if (done >= 1) {
    erase();
    return;
  }
  std::string text = fmt::format("\r{:3.0f} %  {:<32}", 100 * done, stage);
  if (text == shown_) return;
  std::cerr << text << std::flush;
  shown_ = std::move(text);
}

void ProgressLine::erase() {
  if (shown_.empty()) return;
  std::cerr << fmt::format("\r{:<40}\r", "") << std::flush;
  shown_.clear();
}

}  // namespace toothprep::app
