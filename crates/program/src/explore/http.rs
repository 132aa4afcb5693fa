//! The part of HTTP/1.1 that a page on this machine needs: one request a connection, with a body of a stated length. A
//! library parses requests. A body in chunks is refused, so the end of a request is unambiguous.

use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// The longest head and the longest body, in bytes.
const LONGEST_HEAD: usize = 16 << 10;
const LONGEST_BODY: usize = 256 << 10;
/// The most headers of a request.
const MOST_HEADERS: usize = 64;
/// Longest time for the head of a request, and then for its body.
const PATIENCE: Duration = Duration::from_secs(10);
/// Headers that let a request in or show its end. Each may occur once only: a repeated one would be ambiguous.
const ONCE: [&str; 6] = ["host", "origin", "x-token", "content-type", "content-length", "transfer-encoding"];
/// Policy with which a browser loads nothing from elsewhere, sends nothing there, and shows the page in no other.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A request.
#[derive(Debug)]
pub struct Request {
    pub method: String,
    /// Path without its query.
    pub path: String,
    query: String,
    headers: Vec<(String, String)>,
    /// Bytes that followed the head, until the body is read.
    pub body: Vec<u8>,
}

/// Reason why there is no answer: status and text.
pub type Refusal = (u16, String);

impl Request {
    /// Reads the head of a request. It is refused after the deadline, however often a byte comes.
    pub fn head(stream: &mut TcpStream) -> Result<Self, Refusal> {
        stream.set_write_timeout(Some(PATIENCE)).map_err(failed)?;
        let deadline = Instant::now() + PATIENCE;
        let mut bytes = Vec::new();
        let (mut request, head) = loop {
            let mut part = [0; 4096];
            match read_by(stream, deadline, &mut part)? {
                0 => return Err((400, "the request ends within its head".to_owned())),
                count => bytes.extend_from_slice(&part[..count]),
            }
            if let Some(found) = parsed(&bytes)?.filter(|(_, head)| *head <= LONGEST_HEAD) {
                break found;
            }
            if bytes.len() > LONGEST_HEAD {
                return Err((431, format!("the head of a request must have at most {LONGEST_HEAD} bytes")));
            }
        };
        request.body = bytes.split_off(head);
        Ok(request)
    }

    /// Reads the body of a request after its head.
    pub fn read_body(&mut self, stream: &mut TcpStream) -> Result<(), Refusal> {
        let deadline = Instant::now() + PATIENCE;
        let length = self.length()?;
        self.body.truncate(length);
        while self.body.len() < length {
            let mut part = [0; 4096];
            let most = part.len().min(length - self.body.len());
            match read_by(stream, deadline, &mut part[..most])? {
                0 => return Err((400, "the request ends within its body".to_owned())),
                count => self.body.extend_from_slice(&part[..count]),
            }
        }
        Ok(())
    }

    /// The only value of a header; none if it is missing or there are several.
    pub fn header(&self, name: &str) -> Option<&str> {
        let mut found = self.headers.iter().filter(|(known, _)| known.eq_ignore_ascii_case(name));
        let (_, value) = found.next()?;
        found.next().is_none().then_some(value)
    }

    fn has(&self, name: &str) -> bool {
        self.headers.iter().any(|(known, _)| known.eq_ignore_ascii_case(name))
    }

    /// The only value of this name in the query. Queries of this server need no escapes.
    pub fn asked(&self, name: &str) -> Option<&str> {
        let pairs = self.query.split('&').filter_map(|pair| pair.split_once('='));
        let mut found = pairs.filter(|(key, _)| *key == name);
        let (_, value) = found.next()?;
        found.next().is_none().then_some(value)
    }

    fn length(&self) -> Result<usize, Refusal> {
        if self.has("transfer-encoding") {
            return Err((411, "a body must have a Content-Length; chunks are not supported".to_owned()));
        }
        if !self.has("content-length") {
            return Ok(0);
        }
        let digits = self.header("content-length").filter(|text| text.bytes().all(|byte| byte.is_ascii_digit()));
        let length = digits.and_then(|text| text.parse().ok());
        let length: usize = length.ok_or_else(|| (400, "Content-Length must be one whole number".to_owned()))?;
        if length > LONGEST_BODY {
            return Err((413, format!("a body of {length} bytes: at most {LONGEST_BODY} are allowed")));
        }
        Ok(length)
    }
}

fn failed(error: io::Error) -> Refusal {
    match error.kind() {
        ErrorKind::WouldBlock | ErrorKind::TimedOut => (408, "the request did not arrive in time".to_owned()),
        _ => (400, format!("the request can't be read: {error}")),
    }
}

/// Reads available bytes, or waits for some until the deadline.
fn read_by(stream: &mut TcpStream, deadline: Instant, part: &mut [u8]) -> Result<usize, Refusal> {
    let left = deadline.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return Err(failed(ErrorKind::TimedOut.into()));
    }
    stream.set_read_timeout(Some(left)).and_then(|()| stream.read(part)).map_err(failed)
}

/// The head of a request and its length, once it is complete.
fn parsed(bytes: &[u8]) -> Result<Option<(Request, usize)>, Refusal> {
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut head = httparse::Request::new(&mut headers);
    let status = head.parse(bytes).map_err(|error| (400, format!("this is not an HTTP request: {error}")))?;
    let httparse::Status::Complete(length) = status else { return Ok(None) };
    let is_twice = |name: &&str| head.headers.iter().filter(|it| it.name.eq_ignore_ascii_case(name)).count() > 1;
    if let Some(name) = ONCE.iter().find(|name| is_twice(name)) {
        return Err((400, format!("the header {name} must be given at most once")));
    }
    let (path, query) = head.path.unwrap_or("/").split_once('?').unwrap_or((head.path.unwrap_or("/"), ""));
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let request = Request {
        method: head.method.unwrap_or_default().to_owned(),
        path: path.to_owned(),
        query: query.to_owned(),
        headers: head.headers.iter().map(|header| (header.name.to_owned(), text(header.value))).collect(),
        body: Vec::new(),
    };
    Ok(Some((request, length)))
}

/// Begins an answer whose body ends with the connection.
pub fn begin(stream: &mut TcpStream, status: u16, kind: &str, further: &str) -> io::Result<()> {
    let reason = match status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        411 => "Length Required",
        413 => "Content Too Large",
        415 => "Unsupported Media Type",
        431 => "Request Header Fields Too Large",
        503 => "Service Unavailable",
        _ => "Unprocessable Content",
    };
    write!(
        stream,
        "HTTP/1.1 {status} {reason}\r\nContent-Type: {kind}\r\nConnection: close\r\nCache-Control: no-store\r\n\
         Content-Security-Policy: {POLICY}\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\n{further}\r\n"
    )
}

/// Writes a whole answer.
pub fn answer(stream: &mut TcpStream, status: u16, kind: &str, further: &str, body: &[u8]) -> io::Result<()> {
    begin(stream, status, kind, &format!("{further}Content-Length: {}\r\n", body.len()))?;
    stream.write_all(body)?;
    stream.flush()
}

#[cfg(test)]
mod tests {
    use super::{ONCE, parsed};

    #[test]
    fn a_request_is_taken_apart() {
        let text = b"POST /run?token=a&n=1 HTTP/1.1\r\nHost: 127.0.0.1:1\r\ncontent-length: 2\r\n\r\n{}";
        let (request, head) = parsed(text).unwrap().unwrap();
        assert_eq!((request.method.as_str(), request.path.as_str(), &text[head..]), ("POST", "/run", &b"{}"[..]));
        assert_eq!((request.asked("token"), request.asked("m")), (Some("a"), None));
        assert_eq!((request.header("HOST"), request.length().unwrap()), (Some("127.0.0.1:1"), 2));
        assert!(parsed(b"GET / HTTP/1.1\r\nHost:").unwrap().is_none() && parsed(b"\0\x01 nothing").is_err());
    }

    #[test]
    fn what_lets_a_request_in_is_given_once() {
        for name in ONCE {
            for second in ["b", "a", ""] {
                let text =
                    format!("GET / HTTP/1.1\r\n{name}: a\r\nAccept: x\r\n{}: {second}\r\n\r\n", name.to_uppercase());
                let (status, reason) = parsed(text.as_bytes()).unwrap_err();
                assert!(status == 400 && reason.contains(name), "{reason}");
            }
        }
        let (request, _) = parsed(b"GET /?token=a&token=b HTTP/1.1\r\n\r\n").unwrap().unwrap();
        assert_eq!(request.asked("token"), None);
    }

    #[test]
    fn a_body_whose_end_could_be_mistaken_is_refused() {
        let refused = |headers: &str| {
            let text = format!("POST / HTTP/1.1\r\n{headers}\r\n\r\n");
            parsed(text.as_bytes())
                .map(|found| found.unwrap().0.length().unwrap_err().0)
                .unwrap_or_else(|(status, _)| status)
        };
        assert_eq!(refused("Transfer-Encoding: chunked\r\nContent-Length: 3"), 411);
        assert_eq!(refused("Transfer-Encoding: nothing known"), 411);
        assert_eq!(refused("Content-Length: 3\r\nContent-Length: 4"), 400);
        assert_eq!(refused("Transfer-Encoding: chunked\r\ntransfer-encoding: identity"), 400);
        assert_eq!(refused("Content-Length: +3"), 400);
        assert_eq!(refused("Content-Length: 99999999"), 413);
    }
}
