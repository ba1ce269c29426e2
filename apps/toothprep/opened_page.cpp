#include "opened_page.h"

#include <stdlib.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "toothprep/step/core/errors.h"
#include "toothprep/tools/io/child_process.h"

namespace toothprep::app {

OpenedPage::OpenedPage(const std::string& address) {
  if (!std::getenv("DISPLAY") && !std::getenv("WAYLAND_DISPLAY")) return;
  std::error_code error;
  const char* own = std::getenv("XDG_RUNTIME_DIR");
  path_ = own ? std::string(own) : std::filesystem::temp_directory_path(error).string();
  path_ += "/toothprep-view-XXXXXX.html";
  const int file = mkstemps(path_.data(), 5);
  if (file < 0) {
    path_.clear();
    return;
  }
  close(file);
  std::ofstream(path_) << "<!doctype html><meta http-equiv=\"refresh\" content=\"0;url=" << address
                       << "\"><title>toothprep</title>\n";
  ChildOptions quiet;
  quiet.stdout_file = quiet.stderr_file = "/dev/null";
  try {  // in a session of its own, so that it outlives this program and its Ctrl-C
    ChildProcess({"/usr/bin/setsid", "-f", "/usr/bin/xdg-open", path_}, quiet).wait();
  } catch (const Error&) {  // there is none: the address is printed, too
  }
}

OpenedPage::~OpenedPage() {
  std::error_code ignored;
  if (!path_.empty()) std::filesystem::remove(path_, ignored);
}

}  // namespace toothprep::app
