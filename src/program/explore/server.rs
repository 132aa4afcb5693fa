//! The server of a page: on this machine alone, and only for whoever has its token.

use std::io::{self, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use serde_json::{Value, json};

use super::http::{Refusal, Request, answer, begin};
use super::page::{self, Backend};
use super::session::{Session, Wanted};

/// Places beside those of the page's files.
const PATHS: [&str; 6] = ["/", "/loop", "/run", "/set", "/save", "/export"];
const HTML: &str = "text/html; charset=utf-8";
const JSON: &str = "application/json";
/// So many connections are answered at a time.
const MOST_CONNECTIONS: usize = 32;
/// So many bytes of a refused request are read that nobody looks at.
const REST: usize = 1 << 20;

/// A server that listens.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    token: String,
    session: Arc<Session>,
}

/// A token that nobody guesses: 128 random bits.
///
/// # Errors
/// When the system gives no random numbers.
pub fn token() -> io::Result<String> {
    let mut bits = [0; 16];
    getrandom::fill(&mut bits)?;
    Ok(bits.iter().map(|byte| format!("{byte:02x}")).collect())
}

impl Server {
    /// Listens on the loopback address at a port; 0 is any that is free.
    ///
    /// # Errors
    /// When the port can't be had.
    pub fn new(session: Arc<Session>, port: u16, token: String) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let address = listener.local_addr()?;
        Ok(Server { listener, address, token, session })
    }

    /// Where its page is.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.token)
    }

    /// Answers whoever asks, until the process ends.
    pub fn serve(self) {
        let server = Arc::new(self);
        let open = Arc::new(AtomicUsize::new(0));
        for stream in server.listener.incoming() {
            // One that was closed meanwhile.
            let Ok(mut stream) = stream else { continue };
            if open.fetch_add(1, Ordering::SeqCst) >= MOST_CONNECTIONS {
                open.fetch_sub(1, Ordering::SeqCst);
                continue;
            }
            let (server, open) = (Arc::clone(&server), Arc::clone(&open));
            thread::spawn(move || {
                // Who doesn't listen any more is told nothing.
                let _ = server.answer(&mut stream);
                open.fetch_sub(1, Ordering::SeqCst);
            });
        }
    }

    fn answer(&self, stream: &mut TcpStream) -> io::Result<()> {
        stream.set_nodelay(true)?;
        let request = Request::read(stream).and_then(|request| self.check(&request).map(|()| request));
        let request = match request {
            Ok(request) => request,
            Err((status, reason)) => {
                answer(stream, status, JSON, "", json!({ "error": reason }).to_string().as_bytes())?;
                return drained(stream);
            }
        };
        let told = |value: Value| (JSON, value.to_string());
        let answered = match (request.method.as_str(), request.path.as_str()) {
            ("GET", "/") => Ok((HTML, self.page())),
            ("GET", "/loop") => Ok(told(self.session.told())),
            ("POST", "/run") => match wanted(&request) {
                Ok(wanted) => return self.run(stream, &wanted),
                Err(refusal) => Err(refusal),
            },
            ("POST", "/set") => kept(&request, |wanted| Ok(json!({ "set": self.session.set(wanted)? }))).map(told),
            ("POST", "/save") => kept(&request, |wanted| Ok(json!({ "file": self.session.save(wanted)? }))).map(told),
            ("POST", "/export") => kept(&request, |wanted| Ok(json!(self.session.export(wanted)?))).map(told),
            (method, path) => match page::file(path.trim_start_matches('/'), Backend::SERVER) {
                Some((kind, text)) if method == "GET" => Ok((kind, text)),
                None if !PATHS.contains(&path) => Err((404, "there is no such page".to_owned())),
                _ => Err((405, format!("{path} can't be asked for by {method}"))),
            },
        };
        match answered {
            Ok((kind, text)) => answer(stream, 200, kind, "", text.as_bytes()),
            Err((status, reason)) => {
                answer(stream, status, JSON, "", json!({ "error": reason }).to_string().as_bytes())
            }
        }
    }

    /// Whether a request comes from this server's own page: by this machine's name, so that no other name was made to lead
    /// here, with the token, and from no page of anybody else.
    fn check(&self, request: &Request) -> Result<(), Refusal> {
        let port = self.address.port();
        let own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        let host = request.header("host").unwrap_or_default();
        if !own.iter().any(|name| name == host) {
            return Err((403, "this server answers as 127.0.0.1 and localhost alone".to_owned()));
        }
        if request.header("origin").is_some_and(|origin| !own.iter().any(|name| origin == format!("http://{name}"))) {
            return Err((403, "this server answers its own page alone".to_owned()));
        }
        let given = request.header("x-token").or_else(|| request.asked("token")).unwrap_or_default();
        if !same(given, &self.token) {
            let reason = "the token of this page is missing or another's: open the address that `explore` printed";
            return Err((403, reason.to_owned()));
        }
        Ok(())
    }

    fn page(&self) -> String {
        page::html(self.session.name(), Backend::SERVER, &format!("?token={}", self.token))
    }

    /// Runs the loop, and answers a line of JSON now and then, the result last.
    fn run(&self, stream: &mut TcpStream, wanted: &Wanted) -> io::Result<()> {
        begin(stream, 200, "application/x-ndjson", "")?;
        let mut tell = |line: Value| writeln!(stream, "{line}").and_then(|()| stream.flush()).is_ok();
        let line = self.session.run(wanted, &mut tell).unwrap_or_else(|reason| json!({ "error": reason }));
        tell(line);
        Ok(())
    }
}

/// Whether two texts are the same, in a time that doesn't tell how far they are.
fn same(given: &str, token: &str) -> bool {
    given.len() == token.len() && given.bytes().zip(token.bytes()).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

/// What a page asks for.
fn wanted(request: &Request) -> Result<Wanted, Refusal> {
    let kind = request.header("content-type").and_then(|kind| kind.split(';').next()).unwrap_or_default();
    if kind.trim() != JSON {
        return Err((415, format!("a request must be of type {JSON}")));
    }
    serde_json::from_slice(&request.body).map_err(|error| (400, format!("a request that isn't understood: {error}")))
}

fn kept(request: &Request, keep: impl Fn(&Wanted) -> Result<Value, String>) -> Result<Value, Refusal> {
    keep(&wanted(request)?).map_err(|reason| (422, reason))
}

/// Reads on for a while: a connection that is closed with bytes unread takes its answer back.
fn drained(stream: &mut TcpStream) -> io::Result<()> {
    stream.shutdown(std::net::Shutdown::Write)?;
    let mut rest = io::Read::take(stream, REST as u64);
    io::copy(&mut rest, &mut io::sink()).map(|_| ())
}
