#include "toothprep/tools/view/page_assets.h"

#include <string>

// The assembler takes the files as they are: CMakeLists.txt says where they lie.
#define TOOTHPREP_PAGE_FILE(name, path)                                              \
  __asm__(                                                                           \
      ".pushsection .rodata\n"                                                       \
      ".global toothprep_page_" #name "\ntoothprep_page_" #name ":\n.incbin \"" path \
      "\"\n"                                                                         \
      ".global toothprep_page_" #name "_end\ntoothprep_page_" #name                  \
      "_end:\n.byte 0\n.popsection\n");                                              \
  extern "C" const char toothprep_page_##name[], toothprep_page_##name##_end[]

TOOTHPREP_PAGE_FILE(html, TOOTHPREP_PAGE_FOLDER "/page.html");
TOOTHPREP_PAGE_FILE(css, TOOTHPREP_PAGE_FOLDER "/page.css");
TOOTHPREP_PAGE_FILE(icon, TOOTHPREP_PAGE_FOLDER "/icon.svg");
TOOTHPREP_PAGE_FILE(data, TOOTHPREP_PAGE_FOLDER "/data.js");
TOOTHPREP_PAGE_FILE(scene, TOOTHPREP_PAGE_FOLDER "/scene.js");
TOOTHPREP_PAGE_FILE(surface, TOOTHPREP_PAGE_FOLDER "/surface.js");
TOOTHPREP_PAGE_FILE(instruments, TOOTHPREP_PAGE_FOLDER "/instruments.js");
TOOTHPREP_PAGE_FILE(timeline, TOOTHPREP_PAGE_FOLDER "/timeline.js");
TOOTHPREP_PAGE_FILE(control, TOOTHPREP_PAGE_FOLDER "/control.js");
TOOTHPREP_PAGE_FILE(report, TOOTHPREP_PAGE_FOLDER "/report.js");
TOOTHPREP_PAGE_FILE(stereo, TOOTHPREP_PAGE_FOLDER "/stereo.js");
TOOTHPREP_PAGE_FILE(sound, TOOTHPREP_PAGE_FOLDER "/sound.js");
TOOTHPREP_PAGE_FILE(reflector, TOOTHPREP_THREE "/examples/js/objects/Reflector.js");
TOOTHPREP_PAGE_FILE(vr_button, TOOTHPREP_THREE "/examples/jsm/webxr/VRButton.js");
TOOTHPREP_PAGE_FILE(page, TOOTHPREP_PAGE_FOLDER "/page.js");
TOOTHPREP_PAGE_FILE(three, TOOTHPREP_THREE "/three.min.js");
TOOTHPREP_PAGE_FILE(orbit, TOOTHPREP_THREE "/examples/js/controls/OrbitControls.js");
TOOTHPREP_PAGE_FILE(dygraph, TOOTHPREP_DYGRAPHS "/dygraph.min.js");
TOOTHPREP_PAGE_FILE(dygraph_css, TOOTHPREP_DYGRAPHS "/dygraph.min.css");
TOOTHPREP_PAGE_FILE(three_licence, TOOTHPREP_THREE_LICENCE);
TOOTHPREP_PAGE_FILE(dygraph_licence, TOOTHPREP_DYGRAPHS_LICENCE);

namespace toothprep {
namespace {

struct File {
  std::string_view path, type;
  const char *begin, *end;
};

constexpr std::string_view kHtml = "text/html; charset=utf-8", kCss = "text/css; charset=utf-8",
                           kScript = "text/javascript; charset=utf-8",
                           kText = "text/plain; charset=utf-8";

const File kFiles[] = {
    {"", kHtml, toothprep_page_html, toothprep_page_html_end},
    {"page.css", kCss, toothprep_page_css, toothprep_page_css_end},
    {"icon.svg", "image/svg+xml", toothprep_page_icon, toothprep_page_icon_end},
    {"data.js", kScript, toothprep_page_data, toothprep_page_data_end},
    {"scene.js", kScript, toothprep_page_scene, toothprep_page_scene_end},
    {"surface.js", kScript, toothprep_page_surface, toothprep_page_surface_end},
    {"instruments.js", kScript, toothprep_page_instruments, toothprep_page_instruments_end},
    {"timeline.js", kScript, toothprep_page_timeline, toothprep_page_timeline_end},
    {"control.js", kScript, toothprep_page_control, toothprep_page_control_end},
    {"report.js", kScript, toothprep_page_report, toothprep_page_report_end},
    {"stereo.js", kScript, toothprep_page_stereo, toothprep_page_stereo_end},
    {"sound.js", kScript, toothprep_page_sound, toothprep_page_sound_end},
    {"reflector.js", kScript, toothprep_page_reflector, toothprep_page_reflector_end},
    {"vr-button.js", kScript, toothprep_page_vr_button, toothprep_page_vr_button_end},
    {"page.js", kScript, toothprep_page_page, toothprep_page_page_end},
    {"three.js", kScript, toothprep_page_three, toothprep_page_three_end},
    {"orbit.js", kScript, toothprep_page_orbit, toothprep_page_orbit_end},
    {"dygraph.js", kScript, toothprep_page_dygraph, toothprep_page_dygraph_end},
    {"dygraph.css", kCss, toothprep_page_dygraph_css, toothprep_page_dygraph_css_end},
    {"three-licence", kText, toothprep_page_three_licence, toothprep_page_three_licence_end},
    {"dygraphs-licence", kText, toothprep_page_dygraph_licence, toothprep_page_dygraph_licence_end},
};

}  // namespace

std::optional<PageAnswer> page_asset(std::string_view path) {
  for (const File& file : kFiles)
    if (file.path == path)
      return PageAnswer{std::string(file.type), std::string(file.begin, file.end)};
  return std::nullopt;
}

}  // namespace toothprep
