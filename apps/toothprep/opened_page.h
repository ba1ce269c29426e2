// A page of this program in the user's browser.
#pragma once

#include <string>

namespace toothprep::app {

// Shows an address in the default browser, if there is a screen. By a file that only this user can
// read: the command line of a program is seen by everybody on the machine, and the address has the
// page's token.
class OpenedPage {
 public:
  explicit OpenedPage(const std::string& address);
  ~OpenedPage();  // the browser stays
  OpenedPage(const OpenedPage&) = delete;
  OpenedPage& operator=(const OpenedPage&) = delete;

 private:
  std::string path_;
};

}  // namespace toothprep::app
