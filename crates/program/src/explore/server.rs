//! Server of a page: on this machine only, and only for clients that have its token.

use std::collections::VecDeque;
use std::io::{self, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use serde_json::{Value, json};

use super::http::{Refusal, Request, answer, begin};
use super::page::{self, Backend};
use super::session::{Session, Wanted};

/// Places in addition to those of the page's files.
const PATHS: [&str; 6] = ["/", "/loop", "/run", "/set", "/save", "/export"];
const HTML: &str = "text/html; charset=utf-8";
const JSON: &str = "application/json";
/// The most requests with the token that are answered at a time.
const MOST_ANSWERED: usize = 32;
/// The most connections that haven't shown it yet. A further one replaces the oldest, so that connections without the
/// token never block the others.
const MOST_WAITING: usize = 64;
/// The most bytes of a refused request that are read and ignored.
const REST: usize = 1 << 20;
const LISTENING: Duration = Duration::from_secs(1);

/// A server that listens.
#[derive(Debug)]
pub struct Server {
    listener: TcpListener,
    address: SocketAddr,
    token: String,
    session: Arc<Session>,
    /// Connections that haven't shown the token, the oldest first, with their numbers.
    waiting: Mutex<VecDeque<(u64, TcpStream)>>,
    answered: AtomicUsize,
}

/// A token of 128 random bits, which nobody can guess.
///
/// # Errors
/// When the system gives no random numbers.
pub fn token() -> io::Result<String> {
    let mut bits = [0; 16];
    getrandom::fill(&mut bits)?;
    Ok(bits.iter().map(|byte| format!("{byte:02x}")).collect())
}

impl Server {
    /// Listens on the loopback address at a port; 0 chooses a free one.
    ///
    /// # Errors
    /// When the port isn't available.
    pub fn new(session: Arc<Session>, port: u16, token: String) -> io::Result<Self> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port))?;
        let address = listener.local_addr()?;
        Ok(Server { listener, address, token, session, waiting: Mutex::default(), answered: AtomicUsize::new(0) })
    }

    /// Address of its page.
    pub fn url(&self) -> String {
        format!("http://{}/?token={}", self.address, self.token)
    }

    /// Answers all requests until the process ends.
    pub fn serve(self) {
        let server = Arc::new(self);
        // Connections that were closed meanwhile are skipped.
        for (number, stream) in (0..).zip(server.listener.incoming().flatten()) {
            let Ok(other) = stream.try_clone() else { continue };
            server.waits(number, other);
            let answering = Arc::clone(&server);
            let begun = thread::Builder::new().spawn(move || {
                // A client that is gone gets no answer.
                let _ = answering.let_in(number, stream);
                answering.waits_no_more(number);
            });
            if begun.is_err() {
                server.waits_no_more(number);
            }
        }
    }

    fn waits(&self, number: u64, stream: TcpStream) {
        let mut waiting = self.waiting.lock().unwrap_or_else(PoisonError::into_inner);
        waiting.push_back((number, stream));
        if waiting.len() > MOST_WAITING
            && let Some((_, oldest)) = waiting.pop_front()
        {
            let _ = oldest.shutdown(Shutdown::Both);
        }
    }

    fn waits_no_more(&self, number: u64) {
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner).retain(|(other, _)| *other != number);
    }

    /// Answers a connection that shows the token, at a place of its own; refuses another one with the reason.
    fn let_in(&self, number: u64, mut stream: TcpStream) -> io::Result<()> {
        stream.set_nodelay(true)?;
        let request = Request::head(&mut stream).and_then(|request| self.check(&request).map(|()| request));
        let request = match request {
            Ok(request) => request,
            Err(refusal) => return refused(&mut stream, refusal),
        };
        self.waits_no_more(number);
        match Place::take(&self.answered) {
            Some(_place) => self.answer(request, &mut stream),
            None => refused(&mut stream, (503, format!("too many simultaneous requests ({MOST_ANSWERED}). Try again"))),
        }
    }

    fn answer(&self, mut request: Request, stream: &mut TcpStream) -> io::Result<()> {
        if let Err(refusal) = request.read_body(stream) {
            return refused(stream, refusal);
        }
        let json_reply = |value: Value| (JSON, value.to_string());
        let answered = match (request.method.as_str(), request.path.as_str()) {
            ("GET", "/") => Ok((HTML, self.page())),
            ("GET", "/loop") => Ok(json_reply(self.session.to_json())),
            ("POST", "/run") => match wanted(&request) {
                Ok(wanted) => return self.run(stream, &wanted),
                Err(refusal) => Err(refusal),
            },
            ("POST", "/set") => {
                answer_wanted(&request, |wanted| Ok(json!({ "set": self.session.set(wanted)? }))).map(json_reply)
            }
            ("POST", "/save") => answer_wanted(&request, |wanted| self.session.save(wanted)).map(json_reply),
            ("POST", "/export") => answer_wanted(&request, |wanted| self.session.export(wanted)).map(json_reply),
            (method, path) => match page::file(path.trim_start_matches('/'), Backend::SERVER) {
                Some((kind, text)) if method == "GET" => Ok((kind, text)),
                None if !PATHS.contains(&path) => Err((404, "there is no such page".to_owned())),
                _ => Err((405, format!("{path} does not support {method}"))),
            },
        };
        match answered {
            Ok((kind, text)) => answer(stream, 200, kind, "", text.as_bytes()),
            Err((status, reason)) => {
                answer(stream, status, JSON, "", json!({ "error": reason }).to_string().as_bytes())
            }
        }
    }

    /// Checks that a request comes from this server's own page: it must have the token, come from no other page, and
    /// name this machine, so that no other name was redirected here.
    fn check(&self, request: &Request) -> Result<(), Refusal> {
        let port = self.address.port();
        let own = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        let host = request.header("host").unwrap_or_default();
        if !own.iter().any(|name| name == host) {
            return Err((403, "this server is available only as 127.0.0.1 and localhost".to_owned()));
        }
        if request.header("origin").is_some_and(|origin| !own.iter().any(|name| origin == format!("http://{name}"))) {
            return Err((403, "this server accepts requests only from its own page".to_owned()));
        }
        let given = request.header("x-token").or_else(|| request.asked("token")).unwrap_or_default();
        if !same(given, &self.token) {
            let reason = "the token of this page is missing or wrong. Open the address that `explore` printed";
            return Err((403, reason.to_owned()));
        }
        Ok(())
    }

    fn page(&self) -> String {
        page::html(self.session.name(), Backend::SERVER, &format!("?token={}", self.token))
    }

    /// Runs the loop. The answer has lines of JSON with the progress, the result last.
    fn run(&self, stream: &mut TcpStream, wanted: &Wanted) -> io::Result<()> {
        begin(stream, 200, "application/x-ndjson", "")?;
        let mut send = |line: Value| writeln!(stream, "{line}").and_then(|()| stream.flush()).is_ok();
        let line = self.session.run(wanted, &mut send).unwrap_or_else(|reason| json!({ "error": reason }));
        send(line);
        Ok(())
    }
}

/// A place among the requests being answered, until it is dropped.
struct Place<'a>(&'a AtomicUsize);

impl<'a> Place<'a> {
    fn take(taken: &'a AtomicUsize) -> Option<Self> {
        let place = Place(taken);
        (taken.fetch_add(1, Ordering::SeqCst) < MOST_ANSWERED).then_some(place)
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::SeqCst);
    }
}

/// True if two texts are the same, in a time that doesn't depend on their difference.
fn same(given: &str, token: &str) -> bool {
    given.len() == token.len() && given.bytes().zip(token.bytes()).fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

/// Reads the request of a page.
fn wanted(request: &Request) -> Result<Wanted, Refusal> {
    let kind = request.header("content-type").and_then(|kind| kind.split(';').next()).unwrap_or_default();
    if kind.trim() != JSON {
        return Err((415, format!("a request must have the type {JSON}")));
    }
    serde_json::from_slice(&request.body).map_err(|error| (400, format!("the request can't be read: {error}")))
}

fn answer_wanted(request: &Request, keep: impl Fn(&Wanted) -> Result<Value, String>) -> Result<Value, Refusal> {
    keep(&wanted(request)?).map_err(|reason| (422, reason))
}

/// Answers with a refusal, and reads on for a while: a connection that is closed with unread bytes discards its answer.
fn refused(stream: &mut TcpStream, (status, reason): Refusal) -> io::Result<()> {
    answer(stream, status, JSON, "", json!({ "error": reason }).to_string().as_bytes())?;
    stream.shutdown(Shutdown::Write)?;
    stream.set_read_timeout(Some(LISTENING))?;
    let mut rest = io::Read::take(stream, REST as u64);
    io::copy(&mut rest, &mut io::sink()).map(|_| ())
}
