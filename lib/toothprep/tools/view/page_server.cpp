#include "toothprep/tools/view/page_server.h"

#include <sys/random.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/signal_set.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>
#include <chrono>
#include <thread>
#include <utility>

#include "toothprep/step/core/errors.h"

namespace toothprep {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using tcp = asio::ip::tcp;

constexpr std::size_t kHeaderLimit = 8192, kMessageLimit = 1024;  // bytes
constexpr auto kRequestTime = std::chrono::seconds(10);           // to send a request, or go
constexpr auto kAnswerTime = std::chrono::seconds(60);            // to read what was asked for
constexpr auto kFeedTime = std::chrono::seconds(20);              // of silence on a feed
constexpr auto kFeedPeriod = std::chrono::microseconds(16667);    // 60 Hz
constexpr auto kHearingPeriod = std::chrono::milliseconds(20);    // between messages of a page
constexpr auto kRestAfterError = std::chrono::milliseconds(100);  // of accepting

constexpr int kLeastPriority = 19;

std::string random_token() {
  std::array<unsigned char, 16> bytes{};
  if (getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size()))
    throw Error("the system gives no random numbers for the page's token");
  std::string text;
  for (const unsigned char b : bytes) {
    text += "0123456789abcdef"[b >> 4];
    text += "0123456789abcdef"[b & 15];
  }
  return text;
}

// In a time that says nothing of where they differ.
bool equal(std::string_view a, std::string_view b) {
  unsigned difference = a.size() == b.size() ? 0 : 1;
  for (std::size_t i = 0; i < a.size() && i < b.size(); ++i)
    difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
  return difference == 0;
}

std::string in_url(const asio::ip::address& address) {
  return address.is_v6() ? "[" + address.to_string() + "]" : address.to_string();
}

// What the connections share.
struct Shared {
  PageSource& source;
  std::string token;
  tcp::endpoint endpoint;
  std::size_t connections = 0;

  // Of the Host of a request: this server's address and port. Of one that listens on all of the
  // machine's addresses, any address, but no name: names can be made to point here.
  bool is_own_host(std::string_view host) const {
    const std::string port = ":" + std::to_string(endpoint.port());
    if (host.size() <= port.size() || !host.ends_with(port)) return false;
    host.remove_suffix(port.size());
    if (host == in_url(endpoint.address())) return true;
    if (endpoint.address().is_loopback() || endpoint.address().is_unspecified())
      if (host == "localhost") return true;
    if (!endpoint.address().is_unspecified()) return false;
    if (host.starts_with('[') && host.ends_with(']')) host = host.substr(1, host.size() - 2);
    boost::system::error_code error;
    asio::ip::make_address(std::string(host), error);
    return !error;
  }
};

// Counts itself among the connections.
class Counted {
 public:
  explicit Counted(std::shared_ptr<Shared> shared) : shared_(std::move(shared)) {
    ++shared_->connections;
  }
  ~Counted() {
    if (shared_) --shared_->connections;
  }
  Counted(Counted&& other) noexcept = default;
  Shared& shared() const { return *shared_; }

 private:
  std::shared_ptr<Shared> shared_;
};

using Request = http::request<http::empty_body>;
using Response = http::response<http::string_body>;

// ---- A page that stays connected

class FeedConnection : public std::enable_shared_from_this<FeedConnection> {
 public:
  FeedConnection(beast::tcp_stream&& stream, Counted&& counted, std::unique_ptr<PageFeed> feed)
      : socket_(std::move(stream)),
        counted_(std::move(counted)),
        feed_(std::move(feed)),
        timer_(socket_.get_executor()),
        patience_(socket_.get_executor()) {}

  void accept(const Request& request) {
    socket_.set_option(websocket::stream_base::timeout{kRequestTime, kFeedTime, true});
    socket_.read_message_max(kMessageLimit);
    socket_.binary(true);
    socket_.async_accept(request, [self = shared_from_this()](beast::error_code error) {
      if (error) return;
      self->listen();
      self->wait(std::chrono::microseconds(0));
    });
  }

 private:
  // Reading also answers its pings and sees that it left.
  void listen() {
    socket_.async_read(heard_, [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return self->end();
      const auto bytes = self->heard_.cdata();
      self->feed_->hear({static_cast<const char*>(bytes.data()), bytes.size()});
      self->heard_.consume(self->heard_.size());
      self->patience_.expires_after(kHearingPeriod);
      self->patience_.async_wait([self](beast::error_code stopped) {
        if (!stopped && !self->ended_) self->listen();
      });
    });
  }

  void wait(std::chrono::microseconds time) {
    timer_.expires_after(time);
    timer_.async_wait([self = shared_from_this()](beast::error_code error) {
      if (!error && !self->ended_) self->send();
    });
  }

  void send() {
    message_ = feed_->next();
    if (message_.empty()) return wait(kFeedPeriod);
    const auto begin = std::chrono::steady_clock::now();
    socket_.async_write(asio::buffer(message_),
                        [self = shared_from_this(), begin](beast::error_code error, std::size_t) {
                          if (error) return self->end();
                          const auto taken = std::chrono::duration_cast<std::chrono::microseconds>(
                              std::chrono::steady_clock::now() - begin);
                          self->wait(std::max(std::chrono::microseconds(0), kFeedPeriod - taken));
                        });
  }

  void end() {
    ended_ = true;
    timer_.cancel();
    patience_.cancel();
  }

  websocket::stream<beast::tcp_stream> socket_;
  Counted counted_;
  std::unique_ptr<PageFeed> feed_;
  asio::steady_timer timer_, patience_;
  beast::flat_buffer heard_;
  std::string message_;
  bool ended_ = false;
};

// ---- A connection that asks and is answered

class Connection : public std::enable_shared_from_this<Connection> {
 public:
  Connection(tcp::socket&& socket, Counted&& counted)
      : stream_(std::move(socket)), counted_(std::move(counted)) {}

  void read() {
    parser_.emplace();
    parser_->header_limit(kHeaderLimit);
    parser_->body_limit(0);
    stream_.expires_after(kRequestTime);
    http::async_read(stream_, buffer_, *parser_,
                     [self = shared_from_this()](beast::error_code error, std::size_t) {
                       if (!error) self->judge();
                     });
  }

 private:
  void judge() {
    const Request& request = parser_->get();
    const auto header = [&](http::field name) {
      const auto value = request[name];
      return std::string_view(value.data(), value.size());
    };
    const std::string_view host = header(http::field::host), origin = header(http::field::origin);
    const bool upgrade = websocket::is_upgrade(request);
    std::string_view path(request.target().data(), request.target().size());
    std::string_view query;
    if (const auto mark = path.find('?'); mark != path.npos) {
      query = path.substr(mark + 1);
      path = path.substr(0, mark);
    }
    const std::string start = "/" + counted_.shared().token + "/";
    const bool allowed = counted_.shared().is_own_host(host) &&
                         equal(path.substr(0, start.size()), start) &&
                         (origin.empty() ? !upgrade : origin == "http://" + std::string(host));
    if (!allowed) return answer(http::status::forbidden);
    path.remove_prefix(start.size());
    if (upgrade) return connect_feed(path);
    if (request.method() != http::verb::get && request.method() != http::verb::head)
      return answer(http::status::method_not_allowed);
    std::optional<PageAnswer> found;
    try {
      found = counted_.shared().source.get(path, query);
    } catch (const std::exception& e) {
      return answer(http::status::internal_server_error, {"text/plain; charset=utf-8", e.what()});
    }
    if (!found) return answer(http::status::not_found);
    answer(http::status::ok, std::move(*found));
  }

  void connect_feed(std::string_view path) {
    std::unique_ptr<PageFeed> feed = path == "feed" ? counted_.shared().source.feed() : nullptr;
    if (!feed) return answer(http::status::not_found);
    stream_.expires_never();  // the feed has time limits of its own
    const auto connection =
        std::make_shared<FeedConnection>(std::move(stream_), std::move(counted_), std::move(feed));
    connection->accept(parser_->get());
  }

  void answer(http::status status, PageAnswer content = {}) {
    const Request& request = parser_->get();
    response_ = Response(status, request.version());
    if (content.type.empty()) {
      const auto reason = http::obsolete_reason(status);
      content = {"text/plain; charset=utf-8", std::string(reason.data(), reason.size()) + "\n"};
    }
    const auto host = request[http::field::host];
    response_.set(http::field::content_type, content.type);
    response_.set(http::field::cache_control, "no-store");
    response_.set("X-Content-Type-Options", "nosniff");
    response_.set("Referrer-Policy", "no-referrer");
    response_.set("Cross-Origin-Resource-Policy", "same-origin");
    response_.set("Cross-Origin-Opener-Policy", "same-origin");
    if (status == http::status::ok)  // then the Host is this server's
      response_.set("Content-Security-Policy",
                    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
                    "connect-src 'self' ws://" +
                        std::string(host.data(), host.size()) +
                        "; base-uri 'none'; form-action 'none'; frame-ancestors 'none'");
    response_.keep_alive(status == http::status::ok && request.keep_alive());
    response_.body() = std::move(content.body);
    response_.prepare_payload();
    stream_.expires_after(kAnswerTime);
    const auto done = [self = shared_from_this()](beast::error_code error, std::size_t) {
      if (error) return;
      if (self->response_.keep_alive()) return self->read();
      beast::error_code ignored;
      self->stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    };
    if (request.method() == http::verb::head) {
      serializer_.emplace(response_);
      http::async_write_header(stream_, *serializer_, done);
    } else {
      http::async_write(stream_, response_, done);
    }
  }

  beast::tcp_stream stream_;
  Counted counted_;
  beast::flat_buffer buffer_{2 * kHeaderLimit};
  std::optional<http::request_parser<http::empty_body>> parser_;
  Response response_;
  std::optional<http::response_serializer<http::string_body>> serializer_;
};

}  // namespace

struct PageServer::Work {
  Work(const PageServerSettings& settings, PageSource& source)
      : most(settings.most_connections),
        acceptor(io),
        shared(std::make_shared<Shared>(Shared{source, random_token(), {}, 0})),
        timer(io) {
    boost::system::error_code error;
    const auto address = asio::ip::make_address(settings.bind, error);
    if (error)
      throw Error("'" + settings.bind + "' is no address: give one of this machine, as 127.0.0.1");
    const tcp::endpoint wanted(address, settings.port);
    const auto check = [&](const boost::system::error_code& failure) {
      if (failure)
        throw Error("cannot listen on " + in_url(address) + ":" + std::to_string(settings.port) +
                    ": " + failure.message() + "; give another --port, or 0 for any");
    };
    check(acceptor.open(wanted.protocol(), error));
    check(acceptor.set_option(tcp::acceptor::reuse_address(true), error));
    check(acceptor.bind(wanted, error));
    check(acceptor.listen(asio::socket_base::max_listen_connections, error));
    shared->endpoint = acceptor.local_endpoint();
    accept();
  }

  void accept() {
    acceptor.async_accept([this](boost::system::error_code error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) {  // of descriptors, say: others will be closed
        timer.expires_after(kRestAfterError);
        timer.async_wait([this](boost::system::error_code stopped) {
          if (!stopped) accept();
        });
        return;
      }
      if (shared->connections < most) {
        boost::system::error_code ignored;
        socket.set_option(tcp::no_delay(true), ignored);
        std::make_shared<Connection>(std::move(socket), Counted(shared))->read();
      }
      accept();
    });
  }

  const std::size_t most;
  asio::io_context io{1};
  tcp::acceptor acceptor;
  std::shared_ptr<Shared> shared;
  asio::steady_timer timer;
  std::jthread thread;  // last: it ends before what it uses
};

PageServer::PageServer(const PageServerSettings& settings, PageSource& source)
    : work_(std::make_unique<Work>(settings, source)) {}

PageServer::~PageServer() { work_->io.stop(); }

std::string PageServer::address() const {
  const tcp::endpoint& at = work_->shared->endpoint;
  std::string host = in_url(at.address());
  if (at.address().is_unspecified()) host = at.address().is_v6() ? "[::1]" : "127.0.0.1";
  return "http://" + host + ":" + std::to_string(at.port()) + "/" + work_->shared->token + "/";
}

void PageServer::run_until_signal(const std::function<void()>& ready) {
  asio::signal_set signals(work_->io, SIGINT, SIGTERM, SIGHUP);
  signals.async_wait([this](boost::system::error_code error, int) {
    if (!error) work_->io.stop();
  });
  ready();
  work_->io.run();
}

void PageServer::start() {
  work_->thread = std::jthread([this] {
    // Of this thread alone, in Linux; it doesn't matter much if it can't be had.
    static_cast<void>(setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), kLeastPriority));
    work_->io.run();
  });
}

}  // namespace toothprep
