// sample_score_page DIR: writes the made-up pages there.
#include <cstdio>
#include <fstream>

#include "sample_page.h"

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: sample_score_page DIR\n");
    return 2;
  }
  const std::string folder = argv[1];
  std::ofstream(folder + "/class2.html", std::ios::binary)
      << toothprep::score_page_html(toothprep::testing::spoiled_class2());
  std::ofstream(folder + "/crown.html", std::ios::binary)
      << toothprep::score_page_html(toothprep::testing::good_crown());
}
