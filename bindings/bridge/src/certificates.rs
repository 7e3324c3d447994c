//! TLS certificates for the hosts of a fleet, in PEM: a new authority signs one for each host.
//!
//! The private key of the authority is discarded, so it signs no certificate later.

use std::fs::{self, File};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rcgen::{
    BasicConstraints, CertificateParams, CertifiedIssuer, DnType, ExtendedKeyUsagePurpose, IsCa,
    KeyPair, KeyUsagePurpose,
};

use crate::fleet::Fleet;

/// Name of the file with the authority's certificate.
pub const AUTHORITY_FILE: &str = "ca.pem";
/// Maximum difference between the wall clocks of two hosts.
const CLOCK_DIFFERENCE_MAX: Duration = Duration::from_secs(24 * 3600);

/// Failure to create certificates.
#[derive(Debug, thiserror::Error)]
pub enum CertificatesError {
    /// The fleet file names no folder for them.
    #[error(
        "the fleet file names no folder for certificates: expected `certificates = \"keys\"` in it, or another"
    )]
    NoFolder,
    /// This file exists already.
    #[error("{} exists already and is not overwritten: expected a folder without certificates", .0.display())]
    Exists(PathBuf),
    /// This file cannot be written.
    #[error("cannot write {}: {}", .0.display(), .1)]
    Write(PathBuf, io::Error),
    /// The certificate of this host cannot be signed.
    #[error("cannot create the certificate of {0}: {1}")]
    Sign(String, rcgen::Error),
}

/// Validity period of a certificate.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Validity {
    /// Start of the validity.
    pub not_before: SystemTime,
    /// End of the validity.
    pub not_after: SystemTime,
}

impl Validity {
    /// Returns a validity of `days` days that starts one day in the past, because clocks differ.
    pub fn for_days(days: u32) -> Validity {
        let now = SystemTime::now();
        let until = now + Duration::from_secs(u64::from(days) * 24 * 3600);
        Validity { not_before: now - CLOCK_DIFFERENCE_MAX, not_after: until }
    }
}

/// A certificate authority, whose private key is only in memory.
pub struct Authority(CertifiedIssuer<'static, KeyPair>);

impl Authority {
    /// Creates an authority.
    pub fn new(valid: Validity) -> Result<Authority, CertificatesError> {
        let make = || {
            let mut params = certificate_params("phalanx fleet", Vec::new(), valid)?;
            params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
            params.key_usages = vec![KeyUsagePurpose::KeyCertSign];
            CertifiedIssuer::self_signed(params, KeyPair::generate()?)
        };
        make().map(Authority).map_err(sign_error("the authority"))
    }

    /// Returns the authority's certificate, in PEM.
    pub fn certificate(&self) -> String {
        self.0.pem()
    }

    /// Returns certificate and private key of a host, in PEM. `name`: common name; `address`: `ADDRESS:PORT`
    /// under which other hosts reach it.
    pub fn issue_host_certificate(
        &self,
        name: &str,
        address: &str,
        valid: Validity,
    ) -> Result<(String, String), CertificatesError> {
        let reached = address.rsplit_once(':').map_or(address, |(host, _)| host);
        let reached = reached.trim_matches(['[', ']']);
        let make = || {
            let mut params = certificate_params(name, vec![reached.to_owned()], valid)?;
            params.use_authority_key_identifier_extension = true;
            params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
            // Of two hosts, one connects and the other listens.
            params.extended_key_usages =
                vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
            let key = KeyPair::generate()?;
            Ok((params.signed_by(&key, &self.0)?.pem(), key.serialize_pem()))
        };
        make().map_err(sign_error(name))
    }
}

fn certificate_params(
    name: &str,
    reached: Vec<String>,
    valid: Validity,
) -> Result<CertificateParams, rcgen::Error> {
    let mut params = CertificateParams::new(reached)?;
    params.distinguished_name.push(DnType::CommonName, name);
    params.not_before = valid.not_before.into();
    params.not_after = valid.not_after.into();
    Ok(params)
}

fn sign_error(name: &str) -> impl FnOnce(rcgen::Error) -> CertificatesError {
    let name = name.to_owned();
    move |error| CertificatesError::Sign(name, error)
}

/// Creates the certificates of all hosts of a fleet in its folder: `ca.pem`, and for each host `HOST.pem` and
/// `HOST.key`, which only its owner can read. Returns the written files.
pub fn create_certificates(
    fleet: &Fleet,
    valid: Validity,
) -> Result<Vec<PathBuf>, CertificatesError> {
    let folder = fleet.certificates.as_ref().ok_or(CertificatesError::NoFolder)?;
    let authority = Authority::new(valid)?;
    let mut files = vec![(folder.join(AUTHORITY_FILE), authority.certificate())];
    for host in &fleet.hosts {
        let (certificate, key) =
            authority.issue_host_certificate(&host.name, &host.address, valid)?;
        files.push((folder.join(format!("{}.pem", host.name)), certificate));
        files.push((folder.join(format!("{}.key", host.name)), key));
    }
    if let Some((path, _)) = files.iter().find(|(path, _)| path.exists()) {
        return Err(CertificatesError::Exists(path.clone()));
    }
    let made = fs::DirBuilder::new().recursive(true).mode(0o700).create(folder);
    made.map_err(|error| CertificatesError::Write(folder.clone(), error))?;
    for (path, text) in &files {
        write_private_file(path, text)?;
    }
    Ok(files.into_iter().map(|(path, _)| path).collect())
}

fn write_private_file(path: &Path, text: &str) -> Result<(), CertificatesError> {
    let opened = File::options().write(true).create_new(true).mode(0o600).open(path);
    let written = opened.and_then(|mut file| file.write_all(text.as_bytes()));
    written.map_err(|error| match error.kind() {
        io::ErrorKind::AlreadyExists => CertificatesError::Exists(path.into()),
        _ => CertificatesError::Write(path.into(), error),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fleet::parse_text;
    use std::os::unix::fs::PermissionsExt as _;

    fn fleet(folder: &Path, certificates: &str) -> Fleet {
        let text = format!(
            "plant = \"a\"\n{certificates}\n[[host]]\nname = \"a\"\naddress = \"127.0.0.1:7447\"\n\
             [[host]]\nname = \"b\"\naddress = \"[::1]:7448\"\nrobots = [\"r1\"]\n"
        );
        parse_text(&folder.join("fleet.toml"), &text).unwrap()
    }

    #[test]
    fn host_key_file_is_readable_by_its_owner_only() {
        let folder = tempfile::tempdir().unwrap();
        let fleet = fleet(folder.path(), "certificates = \"keys\"");
        let files = create_certificates(&fleet, Validity::for_days(30)).unwrap();
        let names = files.iter().map(|path| path.strip_prefix(folder.path()).unwrap());
        let expected = ["ca.pem", "a.pem", "a.key", "b.pem", "b.key"];
        assert!(names.eq(expected.iter().map(|name| Path::new("keys").join(name))));
        for path in &files {
            assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o600, "{path:?}");
        }
        let texts: Vec<_> = files.iter().map(|path| fs::read_to_string(path).unwrap()).collect();
        assert!(texts[2].starts_with("-----BEGIN PRIVATE KEY-----"));

        // Existing files are not overwritten.
        let error = create_certificates(&fleet, Validity::for_days(30)).unwrap_err().to_string();
        assert!(error.contains("ca.pem exists already"), "{error}");
        fs::remove_file(&files[0]).unwrap();
        let error = create_certificates(&fleet, Validity::for_days(30)).unwrap_err().to_string();
        assert!(error.contains("a.pem exists already") && !files[0].exists(), "{error}");
        assert_eq!(fs::read_to_string(&files[2]).unwrap(), texts[2]);
    }

    #[test]
    fn fleet_without_certificate_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let error =
            create_certificates(&fleet(folder.path(), ""), Validity::for_days(1)).unwrap_err();
        assert!(matches!(error, CertificatesError::NoFolder), "{error}");
    }
}
