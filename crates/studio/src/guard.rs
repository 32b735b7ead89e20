//! Access control: only the page that this server delivered may send requests.
//!
//! The server listens on the loopback interface only. Other programs of the same machine, and pages
//! of other origins in the same browser, can reach that too. Every request therefore needs the
//! random token of this start, must name the server by its own address (a foreign name that
//! resolves to this machine is refused, which stops DNS rebinding), and must not come from another
//! origin. Requests that change something need the token in a header, which a foreign form cannot
//! send.

use crate::state::Studio;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

/// Header that carries the token.
pub(crate) const TOKEN_HEADER: &str = "x-aloft-token";

/// A new random token: 32 hexadecimal digits.
pub(crate) fn new_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0u8; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

/// Lets a request through, or says why not; adds the headers that keep the page to itself.
pub(crate) async fn guard(State(studio): State<Arc<Studio>>, request: Request, next: Next) -> Response {
    let mut response = match refusal(&studio, request.method(), request.headers(), request.uri().query()) {
        Some(why) => (StatusCode::FORBIDDEN, format!("refused: {why}\n")).into_response(),
        None => next.run(request).await,
    };
    for (name, value) in [
        (header::CACHE_CONTROL, "no-store"),
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::X_FRAME_OPTIONS, "DENY"),
        (header::REFERRER_POLICY, "no-referrer"),
        (header::CONTENT_SECURITY_POLICY, "frame-ancestors 'none'"),
        (header::HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (header::HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

/// Why a request is refused; none if it may pass.
fn refusal(studio: &Studio, method: &Method, headers: &HeaderMap, query: Option<&str>) -> Option<&'static str> {
    // none: a header that is no text is refused
    let text = |name: &str| headers.get(name).and_then(|v| v.to_str().ok());
    let hosts = [format!("127.0.0.1:{}", studio.port), format!("localhost:{}", studio.port)];
    let host = text("host").filter(|h| hosts.iter().any(|own| own == h));
    let Some(host) = host else { return Some("request refused: wrong host") };
    if headers.contains_key("origin") && text("origin") != Some(&format!("http://{host}")) {
        return Some("the request comes from another page");
    }
    if headers.contains_key("sec-fetch-site") && !matches!(text("sec-fetch-site"), Some("same-origin" | "none")) {
        return Some("the request comes from another page");
    }
    let safe = method == Method::GET || method == Method::HEAD;
    let in_query = query.into_iter().flat_map(|q| q.split('&')).find_map(|p| p.strip_prefix("token="));
    let given = text(TOKEN_HEADER).or(in_query.filter(|_| safe));
    // hashes compare in constant time
    let same = given.is_some_and(|g| blake3::hash(g.as_bytes()) == blake3::hash(studio.token.as_bytes()));
    (!same).then_some("the token is missing or wrong; open the address that `aloft studio` printed")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests fail by panicking")]
mod tests {
    use super::*;
    use crate::endpoints::router;
    use aloft_workspace::error::PipelineError;
    use axum::body::Body;
    use tower::ServiceExt;

    const PORT: u16 = 4711;

    fn studio() -> Arc<Studio> {
        Studio::new(Box::new(|| Err(PipelineError::request("no study here"))), None, new_token().unwrap(), PORT)
            .unwrap()
    }

    /// The status of a request with these headers; `TOKEN` stands for the right token.
    fn status(method: Method, path: &str, headers: &[(&str, &str)]) -> StatusCode {
        let studio = studio();
        let fill = |text: &str| text.replace("TOKEN", &studio.token);
        let mut request = Request::builder().method(method).uri(fill(path));
        for (name, value) in headers {
            request = request.header(*name, fill(value));
        }
        let request = request.body(Body::from("{}")).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let response = runtime.block_on(router(studio).oneshot(request)).unwrap();
        assert_eq!(response.headers()[header::CACHE_CONTROL], "no-store");
        assert_eq!(response.headers()[header::X_FRAME_OPTIONS], "DENY");
        response.status()
    }

    const HOST: (&str, &str) = ("host", "127.0.0.1:4711");

    #[test]
    fn tokens_are_long_and_differ() {
        let (a, b) = (new_token().unwrap(), new_token().unwrap());
        assert!(a.len() == 32 && a != b && a.bytes().all(|c| c.is_ascii_hexdigit()));
    }

    #[test]
    fn the_own_page_passes() {
        // the study cannot be opened, which is an answer of the endpoint, not of the guard
        for headers in [
            vec![HOST],
            vec![("host", "localhost:4711"), ("origin", "http://localhost:4711")],
            vec![HOST, ("origin", "http://127.0.0.1:4711"), ("sec-fetch-site", "same-origin")],
            vec![HOST, ("sec-fetch-site", "none")],
        ] {
            assert_eq!(status(Method::GET, "/api/state?token=TOKEN", &headers), StatusCode::CONFLICT, "{headers:?}");
            let with_header: Vec<_> = headers.into_iter().chain([(TOKEN_HEADER, "TOKEN")]).collect();
            assert_eq!(status(Method::GET, "/api/state", &with_header), StatusCode::CONFLICT);
        }
    }

    #[test]
    fn wrong_tokens_are_refused() {
        for path in ["/", "/?token=", "/?token=0123456789abcdef0123456789abcdef", "/api/events", "/?nottoken=TOKEN"] {
            assert_eq!(status(Method::GET, path, &[HOST]), StatusCode::FORBIDDEN, "{path}");
        }
        let short = [HOST, (TOKEN_HEADER, "")];
        assert_eq!(status(Method::GET, "/api/state", &short), StatusCode::FORBIDDEN);
    }

    #[test]
    fn other_hosts_and_origins_are_refused() {
        for headers in [
            vec![],
            vec![("host", "evil.example:4711")],
            vec![("host", "127.0.0.1")],
            vec![("host", "127.0.0.1:80")],
            vec![("host", "127.0.0.1.evil.example:4711")],
            vec![HOST, ("origin", "http://evil.example")],
            vec![HOST, ("origin", "http://localhost:4711")],
            vec![HOST, ("origin", "https://127.0.0.1:4711")],
            vec![HOST, ("origin", "null")],
            vec![HOST, ("sec-fetch-site", "cross-site")],
            vec![HOST, ("sec-fetch-site", "same-site")],
        ] {
            assert_eq!(status(Method::GET, "/api/state?token=TOKEN", &headers), StatusCode::FORBIDDEN, "{headers:?}");
        }
    }

    #[test]
    fn changes_need_the_token_in_a_header() {
        for path in ["/api/job?token=TOKEN", "/api/model?token=TOKEN"] {
            assert_eq!(status(Method::POST, path, &[HOST]), StatusCode::FORBIDDEN);
        }
        let right = [HOST, (TOKEN_HEADER, "TOKEN")];
        assert_eq!(status(Method::POST, "/api/job", &right), StatusCode::BAD_REQUEST, "`{{}}` is no job");
    }

    #[test]
    fn there_are_no_files_to_reach() {
        let right = [HOST, (TOKEN_HEADER, "TOKEN")];
        for path in [
            "/../Cargo.toml",
            "/..%2f..%2fetc%2fpasswd",
            "/%2e%2e/%2e%2e/etc/passwd",
            "/etc/passwd",
            "/model.json",
            "/api/../../model.json",
            "//etc/passwd",
        ] {
            assert_eq!(status(Method::GET, path, &right), StatusCode::NOT_FOUND, "{path}");
            assert_eq!(status(Method::GET, path, &[HOST]), StatusCode::FORBIDDEN, "{path}");
        }
    }
}
