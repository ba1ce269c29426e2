// The one small tree of errors. Whatever is caught in main() becomes one line on stderr and exit 1.
#pragma once

#include <stdexcept>
#include <string>

namespace toothprep {

// The work could not be done; what() is a complete sentence for the user.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Something in a file or an option is not acceptable. what() reads "FILE: PLACE: CONDITION;
// REMEDY", where PLACE (a field, a dataset, a line) and REMEDY may be empty.
class InputError : public Error {
 public:
  InputError(const std::string& file, const std::string& place, const std::string& condition,
             const std::string& remedy = {})
      : Error(file + (place.empty() ? "" : ": " + place) + ": " + condition +
              (remedy.empty() ? "" : "; " + remedy)) {}
};

}  // namespace toothprep
