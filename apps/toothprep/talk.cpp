#include "talk.h"

#include <unistd.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <thread>

#include "toothprep/tools/io/plain_text.h"

namespace toothprep::app {
namespace {

constexpr std::size_t kMostLines = 1000;
constexpr auto kLastWords = std::chrono::milliseconds(500);

void write_all(const std::string& text) {
  for (std::size_t done = 0; done < text.size();) {
    const ssize_t n = write(STDERR_FILENO, text.data() + done, text.size() - done);
    if (n <= 0) return;
    done += static_cast<std::size_t>(n);
  }
}

}  // namespace

struct Talk::Shared {
  std::mutex mutex;
  std::condition_variable changed;
  std::deque<std::string> lines;
  std::string status;
  bool leave = false, idle = false, status_stands = false;

  void run() {
    std::unique_lock lock(mutex);
    for (;;) {
      changed.wait(lock, [this] { return leave || !lines.empty() || !status.empty(); });
      if (lines.empty() && status.empty()) break;  // all is said
      std::string text = status_stands && !lines.empty() ? "\n" : "";
      status_stands = !status.empty() || (status_stands && lines.empty());
      for (const std::string& line : lines) text += line + "\n";
      lines.clear();
      text += status;
      status.clear();
      lock.unlock();
      write_all(text);
      lock.lock();
    }
    if (status_stands) {
      lock.unlock();
      write_all("\n");
      lock.lock();
    }
    idle = true;
    changed.notify_all();
  }
};

Talk::Talk() : shared_(std::make_shared<Shared>()) {
  std::thread([shared = shared_] { shared->run(); }).detach();
}

Talk::~Talk() {
  std::unique_lock lock(shared_->mutex);
  shared_->leave = true;
  shared_->changed.notify_all();
  shared_->changed.wait_for(lock, kLastWords, [this] { return shared_->idle; });
}

void Talk::line(const std::string& text) {
  const std::lock_guard lock(shared_->mutex);
  if (shared_->lines.size() < kMostLines) shared_->lines.push_back(terminal_text(text));
  shared_->changed.notify_all();
}

void Talk::status(const std::string& text) {
  const std::lock_guard lock(shared_->mutex);
  shared_->status = "\r" + terminal_text(text);
  shared_->changed.notify_all();
}

}  // namespace toothprep::app
