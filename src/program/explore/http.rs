//! The little of HTTP/1.1 that a page on this machine needs: one request a connection, a body of a stated length. What a
//! request says is parsed by a library; a body that comes in parts is refused, so there is nothing to be mistaken about where
//! it ends.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// The longest head and the longest body, in bytes.
const LONGEST_HEAD: usize = 16 << 10;
const LONGEST_BODY: usize = 256 << 10;
/// The most headers of a request.
const MOST_HEADERS: usize = 64;
/// How long a request may keep the server waiting.
const PATIENCE: Duration = Duration::from_secs(10);
/// A browser that obeys this loads nothing from elsewhere, sends nothing there, and shows the page in no other.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// A request.
#[derive(Debug)]
pub struct Request {
    pub method: String,
    /// Without its query.
    pub path: String,
    query: String,
    headers: Vec<(String, String)>,
    pub body: Vec<u8>,
}

/// Why there is no answer: status and reason.
pub type Refusal = (u16, String);

impl Request {
    /// Reads one.
    pub fn read(stream: &mut TcpStream) -> Result<Self, Refusal> {
        let failed = |error: io::Error| (400, format!("the request can't be read: {error}"));
        stream.set_read_timeout(Some(PATIENCE)).map_err(failed)?;
        stream.set_write_timeout(Some(PATIENCE)).map_err(failed)?;
        let mut bytes = Vec::new();
        let (mut request, head) = loop {
            let mut part = [0; 4096];
            match stream.read(&mut part).map_err(failed)? {
                0 => return Err((400, "the request ends before its head does".to_owned())),
                count => bytes.extend_from_slice(&part[..count]),
            }
            if let Some(found) = parsed(&bytes)?.filter(|(_, head)| *head <= LONGEST_HEAD) {
                break found;
            }
            if bytes.len() > LONGEST_HEAD {
                return Err((431, format!("the head of a request may have {LONGEST_HEAD} bytes")));
            }
        };
        let length = request.length()?;
        request.body = bytes.split_off(head);
        request.body.truncate(length);
        let missing = length - request.body.len();
        let read = stream.take(missing as u64).read_to_end(&mut request.body).map_err(failed)?;
        if read < missing { Err((400, "the request ends before its body does".to_owned())) } else { Ok(request) }
    }

    /// The only value of a header; none where it is missing or there are several.
    pub fn header(&self, name: &str) -> Option<&str> {
        let mut found = self.headers.iter().filter(|(known, _)| known.eq_ignore_ascii_case(name));
        let (_, value) = found.next()?;
        found.next().is_none().then_some(value)
    }

    fn has(&self, name: &str) -> bool {
        self.headers.iter().any(|(known, _)| known.eq_ignore_ascii_case(name))
    }

    /// A value of the query. What this server asks for needs no escapes.
    pub fn asked(&self, name: &str) -> Option<&str> {
        self.query.split('&').filter_map(|pair| pair.split_once('=')).find(|(key, _)| *key == name).map(|(_, it)| it)
    }

    fn length(&self) -> Result<usize, Refusal> {
        if self.has("transfer-encoding") {
            return Err((411, "a body must come with its Content-Length, not in parts".to_owned()));
        }
        if !self.has("content-length") {
            return Ok(0);
        }
        let digits = self.header("content-length").filter(|text| text.bytes().all(|byte| byte.is_ascii_digit()));
        let length = digits.and_then(|text| text.parse().ok());
        let length: usize = length.ok_or_else(|| (400, "Content-Length must be one whole number".to_owned()))?;
        if length > LONGEST_BODY {
            return Err((413, format!("a body of {length} bytes: at most {LONGEST_BODY} are read")));
        }
        Ok(length)
    }
}

/// The head of a request and its length, where it is there.
fn parsed(bytes: &[u8]) -> Result<Option<(Request, usize)>, Refusal> {
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut head = httparse::Request::new(&mut headers);
    let status = head.parse(bytes).map_err(|error| (400, format!("this is no request of HTTP: {error}")))?;
    let httparse::Status::Complete(length) = status else { return Ok(None) };
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
        411 => "Length Required",
        413 => "Content Too Large",
        415 => "Unsupported Media Type",
        431 => "Request Header Fields Too Large",
        _ => "Unprocessable Content",
    };
    write!(
        stream,
        "HTTP/1.1 {status} {reason}\r\nContent-Type: {kind}\r\nConnection: close\r\nCache-Control: no-store\r\n\
         Content-Security-Policy: {POLICY}\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\n\
         Cross-Origin-Resource-Policy: same-origin\r\n{further}\r\n"
    )
}

/// Answers at once.
pub fn answer(stream: &mut TcpStream, status: u16, kind: &str, further: &str, body: &[u8]) -> io::Result<()> {
    begin(stream, status, kind, &format!("{further}Content-Length: {}\r\n", body.len()))?;
    stream.write_all(body)?;
    stream.flush()
}

#[cfg(test)]
mod tests {
    use super::parsed;

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
    fn a_body_whose_end_could_be_mistaken_is_refused() {
        let refused = |headers: &str| {
            let text = format!("POST / HTTP/1.1\r\n{headers}\r\n\r\n");
            parsed(text.as_bytes()).unwrap().unwrap().0.length().unwrap_err().0
        };
        assert_eq!(refused("Transfer-Encoding: chunked\r\nContent-Length: 3"), 411);
        assert_eq!(refused("Transfer-Encoding: nothing known"), 411);
        assert_eq!(refused("Content-Length: 3\r\nContent-Length: 4"), 400);
        assert_eq!(refused("Content-Length: +3"), 400);
        assert_eq!(refused("Content-Length: 99999999"), 413);
    }
}
