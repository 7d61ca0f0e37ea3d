//! Listens, and gives each connection to the routes: the one file that knows sockets and TLS.
//!
//! Takes addresses, a certificate and the routes. Bounded: connections, of all and of one address, the
//! time of a handshake, of a request's head and of a client that does not read. Until a first user is
//! made, only the loopback is listened on; from then on the configured addresses, without a restart.
//! Knows no route.
use super::auth::Source;
use crate::causes;
use anyhow::Context;
use axum::Router;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore, watch};
use tokio::time::timeout;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::pki_types::pem::PemObject;
use tokio_rustls::rustls::pki_types::{CertificateDer, PrivateKeyDer};

/// Connections at a time: 200 viewers, uploads and slicers, and a bound for a Pi's memory.
const MAX_CONNECTIONS: usize = 512;

/// Connections of one address, unless it is a trusted proxy's: a household behind one router with room
/// to spare, while others still find places.
const MAX_OF_ONE: usize = 384;

/// What a client has not taken by then ends its connection: it has gone, or does not read.
const UNREAD: Duration = Duration::from_secs(60);

/// A client sends its request's head within so long.
const HEAD: Duration = Duration::from_secs(15);

/// A TLS handshake takes no longer.
const HANDSHAKE: Duration = Duration::from_secs(10);

/// Requests that run are waited for so long when the daemon ends.
const LAST_REQUESTS: Duration = Duration::from_secs(3);

/// The other side of a connection.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Peer {
    /// Its address.
    pub(crate) address: SocketAddr,
    /// Whether what is said is encrypted.
    pub(crate) encrypted: bool,
}

/// The certificate and key of `server.tls_cert` and `server.tls_key`.
///
/// # Errors
/// They cannot be read, or are none.
pub(crate) fn tls(cert: &Path, key: &Path) -> anyhow::Result<TlsAcceptor> {
    let told = |path: &Path| format!("{} (PEM)", path.display());
    let chain: Vec<CertificateDer<'static>> = CertificateDer::pem_file_iter(cert)
        .with_context(|| told(cert))?
        .collect::<Result<_, _>>()
        .with_context(|| told(cert))?;
    let key_der = PrivateKeyDer::from_pem_file(key).with_context(|| told(key))?;
    let provider = Arc::new(tokio_rustls::rustls::crypto::ring::default_provider());
    let mut config = ServerConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()?
        .with_no_client_auth()
        .with_single_cert(chain, key_der)
        .with_context(|| format!("{} and {} do not go together", cert.display(), key.display()))?;
    config.alpn_protocols = vec![b"http/1.1".to_vec()];
    Ok(TlsAcceptor::from(Arc::new(config)))
}

/// The same port of the loopback: all that is listened on before there is a user.
pub(crate) fn loopback_of(addresses: &[SocketAddr]) -> Vec<SocketAddr> {
    let mut loopback: Vec<_> = addresses
        .iter()
        .map(|address| match address.ip() {
            ip if ip.is_loopback() => *address,
            IpAddr::V4(_) => SocketAddr::new(Ipv4Addr::LOCALHOST.into(), address.port()),
            IpAddr::V6(_) => SocketAddr::new(Ipv6Addr::LOCALHOST.into(), address.port()),
        })
        .collect();
    loopback.dedup();
    loopback
}

/// Opens the addresses. One that the machine has not (no IPv6) is left out; none at all is an error.
///
/// # Errors
/// No address could be opened; the reason of the first.
pub(crate) fn bind(addresses: &[SocketAddr]) -> anyhow::Result<Vec<TcpListener>> {
    let mut listeners = Vec::new();
    let mut first: Option<anyhow::Error> = None;
    for address in addresses {
        match bind_one(*address) {
            Ok(listener) => listeners.push(listener),
            Err(why) => {
                let why = anyhow::Error::new(why).context(format!("cannot listen on {address}"));
                tracing::debug!("{}", causes::line(&why));
                first.get_or_insert(why);
            }
        }
    }
    match (listeners.is_empty(), first) {
        (true, why) => Err(why.unwrap_or_else(|| anyhow::anyhow!("server.listen names no address"))),
        (false, _) => Ok(listeners),
    }
}

fn bind_one(address: SocketAddr) -> std::io::Result<TcpListener> {
    use rustix::net::{AddressFamily, SocketFlags, SocketType, bind, listen, socket_with, sockopt};
    let family = if address.is_ipv4() { AddressFamily::INET } else { AddressFamily::INET6 };
    let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
    let socket = socket_with(family, SocketType::STREAM, flags, None)?;
    sockopt::set_socket_reuseaddr(&socket, true)?;
    if address.is_ipv6() {
        // `[::]` beside `0.0.0.0` would otherwise be refused.
        sockopt::set_ipv6_v6only(&socket, true)?;
    }
    bind(&socket, &address)?;
    listen(&socket, 128)?;
    TcpListener::from_std(std::net::TcpListener::from(socket))
}

/// Places for connections.
struct Places {
    all: Arc<Semaphore>,
    /// How many of them each source has, unless it is trusted.
    taken: Mutex<HashMap<Source, usize>>,
    trusted: Vec<IpAddr>,
}

/// A connection's place; given back when it is dropped.
struct Place {
    _one_of_all: OwnedSemaphorePermit,
    of: Option<(Arc<Places>, Source)>,
}

impl Places {
    fn new(trusted: &[IpAddr]) -> Arc<Self> {
        Arc::new(Self {
            all: Arc::new(Semaphore::new(MAX_CONNECTIONS)),
            taken: Mutex::default(),
            trusted: trusted.iter().map(|proxy| proxy.to_canonical()).collect(),
        })
    }

    /// A place for one who comes from there, if that address has not too many.
    fn place(self: &Arc<Self>, one_of_all: OwnedSemaphorePermit, from: IpAddr) -> Option<Place> {
        if self.trusted.contains(&from.to_canonical()) {
            return Some(Place { _one_of_all: one_of_all, of: None });
        }
        let source = Source::from(from);
        let mut taken = self.taken.lock().unwrap_or_else(PoisonError::into_inner);
        let its = taken.entry(source).or_default();
        if *its >= MAX_OF_ONE {
            return None;
        }
        *its += 1;
        Some(Place { _one_of_all: one_of_all, of: Some((Arc::clone(self), source)) })
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let Some((places, source)) = self.of.take() else { return };
        let mut taken = places.taken.lock().unwrap_or_else(PoisonError::into_inner);
        if let Entry::Occupied(mut its) = taken.entry(source) {
            *its.get_mut() -= 1;
            if *its.get() == 0 {
                its.remove();
            }
        }
    }
}

/// Serves until `stop` says so. Connections that are open then end their requests. `trusted`: proxies,
/// through which everybody may come.
pub(crate) async fn serve(
    listeners: Vec<TcpListener>,
    tls: Option<TlsAcceptor>,
    routes: Router,
    trusted: &[IpAddr],
    mut stop: watch::Receiver<bool>,
) {
    let places = Places::new(trusted);
    let mut accepting = tokio::task::JoinSet::new();
    for listener in listeners {
        let (tls, routes, stop, places) = (tls.clone(), routes.clone(), stop.clone(), Arc::clone(&places));
        accepting.spawn(accept(listener, tls, routes, stop, places));
    }
    let _ = stop.wait_for(|stop| *stop).await;
    accepting.shutdown().await;
}

async fn accept(
    listener: TcpListener,
    tls: Option<TlsAcceptor>,
    routes: Router,
    stop: watch::Receiver<bool>,
    places: Arc<Places>,
) {
    loop {
        let Ok(one_of_all) = Arc::clone(&places.all).acquire_owned().await else { return };
        let (stream, address) = match listener.accept().await {
            Ok(accepted) => accepted,
            Err(why) => {
                // Out of file descriptors, mostly: others may end soon.
                tracing::warn!("cannot accept a connection: {why}");
                tokio::time::sleep(Duration::from_millis(200)).await;
                continue;
            }
        };
        let Some(place) = places.place(one_of_all, address.ip()) else {
            tracing::debug!(%address, "closed: {MAX_OF_ONE} connections of this address are open");
            continue;
        };
        let (tls, routes, stop) = (tls.clone(), routes.clone(), stop.clone());
        tokio::spawn(async move {
            let _place = place;
            let _ = stream.set_nodelay(true);
            let _ = rustix::net::sockopt::set_tcp_user_timeout(&stream, UNREAD.as_millis() as u32);
            shake_hands(stream, address, tls, routes, stop).await;
        });
    }
}

async fn shake_hands(
    stream: TcpStream,
    address: SocketAddr,
    tls: Option<TlsAcceptor>,
    routes: Router,
    stop: watch::Receiver<bool>,
) {
    match tls {
        None => talk(stream, Peer { address, encrypted: false }, routes, stop).await,
        Some(tls) => match timeout(HANDSHAKE, tls.accept(stream)).await {
            Ok(Ok(stream)) => talk(stream, Peer { address, encrypted: true }, routes, stop).await,
            Ok(Err(why)) => tracing::debug!(%address, "no TLS: {why}"),
            Err(_) => tracing::debug!(%address, "no TLS in time"),
        },
    }
}

async fn talk<S>(stream: S, peer: Peer, routes: Router, mut stop: watch::Receiver<bool>)
where
    S: AsyncRead + AsyncWrite + Unpin + Send + 'static,
{
    let routes = routes.layer(axum::Extension(peer));
    let mut http = hyper::server::conn::http1::Builder::new();
    http.timer(TokioTimer::new()).header_read_timeout(HEAD).max_buf_size(64 << 10);
    let connection =
        http.serve_connection(TokioIo::new(stream), TowerToHyperService::new(routes)).with_upgrades();
    let mut connection = std::pin::pin!(connection);
    tokio::select! {
        done = connection.as_mut() => {
            if let Err(why) = done {
                tracing::debug!(address = %peer.address, "{why}");
            }
            return;
        }
        _ = stop.wait_for(|stop| *stop) => connection.as_mut().graceful_shutdown(),
    }
    let _ = timeout(LAST_REQUESTS, connection).await;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_users_nothing_but_the_loopback_is_opened() {
        let check = |given: &[&str], expect: &[&str]| {
            let given: Vec<SocketAddr> = given.iter().map(|a| a.parse().unwrap()).collect();
            let expect: Vec<SocketAddr> = expect.iter().map(|a| a.parse().unwrap()).collect();
            assert_eq!(loopback_of(&given), expect);
        };
        check(&["0.0.0.0:8080", "[::]:8080"], &["127.0.0.1:8080", "[::1]:8080"]);
        check(&["192.168.1.2:80", "10.0.0.1:80"], &["127.0.0.1:80"]);
        check(&["127.0.0.2:1"], &["127.0.0.2:1"]);
    }

    #[test]
    fn one_address_does_not_take_all_places() {
        let ip = |text: &str| text.parse::<IpAddr>().unwrap();
        let places = Places::new(&[ip("10.0.0.1")]);
        let ask = |from: &str| {
            let one = Arc::clone(&places.all).try_acquire_owned().ok()?;
            places.place(one, ip(from))
        };
        let mut held: Vec<_> = (0..MAX_OF_ONE).map(|_| ask("192.0.2.9").unwrap()).collect();
        assert!(ask("192.0.2.9").is_none() && ask("::ffff:192.0.2.9").is_none());
        let other = ask("192.0.2.8");
        assert!(other.is_some());
        held.pop();
        held.push(ask("192.0.2.9").unwrap());
        drop((held, other));
        assert!(places.taken.lock().unwrap().is_empty());
        // Everybody comes through a proxy.
        let held: Vec<_> = (0..MAX_CONNECTIONS).map_while(|_| ask("10.0.0.1")).collect();
        assert_eq!(held.len(), MAX_CONNECTIONS);
        assert!(ask("192.0.2.8").is_none());
    }

    #[tokio::test]
    async fn an_address_that_is_taken_is_told() {
        let one = bind(&["127.0.0.1:0".parse().unwrap()]).unwrap();
        let taken = one[0].local_addr().unwrap();
        let why = bind(&[taken]).err().map(|e| format!("{e:#}")).unwrap_or_default();
        assert!(why.contains(&taken.to_string()), "{why}");
    }
}
