// The one small tree of errors. Whatever is caught in main() becomes one line on stderr and exit 1.
#pragma once

#include <memory>
#include <stdexcept>
#include <string>

namespace toothprep {

// The work could not be done; what() is a complete sentence for the user.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Something in a file or an option is not acceptable. what() reads "FILE: PLACE: CONDITION;
// REMEDY"; the parts are there by themselves too. PLACE (a field, a dataset, a line) and REMEDY
// may be empty.
class InputError : public Error {
 public:
  InputError(const std::string& file, const std::string& place, const std::string& condition,
             const std::string& remedy = {})  // `file` may be an option's name
      : Error(file + (place.empty() ? "" : ": " + place) + ": " + condition +
              (remedy.empty() ? "" : "; " + remedy)),
        parts_(std::make_shared<const Parts>(Parts{file, place, condition, remedy})) {}
  // The parts by themselves.
  [[nodiscard]] const std::string& file() const noexcept { return parts_->file; }
  [[nodiscard]] const std::string& place() const noexcept { return parts_->place; }
  [[nodiscard]] const std::string& condition() const noexcept { return parts_->condition; }
  [[nodiscard]] const std::string& remedy() const noexcept { return parts_->remedy; }

 private:
  struct Parts {
    std::string file, place, condition, remedy;
  };
  std::shared_ptr<const Parts> parts_;  // shared: copying an exception must not throw
};

}  // namespace toothprep
