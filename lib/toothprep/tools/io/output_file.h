// An output appears whole or not at all: it is written beside its place and renamed at the end.
#pragma once

#include <string>

namespace toothprep {

// Usage: OutputFile out("trace.h5", force); write(out.temporary()); out.commit();
// The constructor refuses (Error) an existing file unless `force`, and a folder that doesn't exist
// or can't be written. Without commit() the destructor removes what was written. With `directory`
// the output is a folder: temporary() is then an existing empty folder beside the final place. A
// folder is replaced only if it holds nothing but plain files; or, with `marker`, if it holds a
// file of that name, and folders of plain files beside it.
class OutputFile {
 public:
  OutputFile(std::string path, bool force, bool directory = false, const std::string& marker = {});
  ~OutputFile();
  OutputFile(const OutputFile&) = delete;
  OutputFile& operator=(const OutputFile&) = delete;

  const std::string& temporary() const { return temporary_; }  // has the final name's extension
  const std::string& path() const { return path_; }
  void commit();  // throws Error if the rename fails

 private:
  std::string path_, temporary_;
  bool directory_ = false, committed_ = false;
};

}  // namespace toothprep
