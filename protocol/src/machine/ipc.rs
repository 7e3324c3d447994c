//! The iceoryx2 variant of a run: the standard interprocess variant, but with memory in files below the
//! configured root instead of POSIX shared memory, which is always in /dev/shm. A run is thus one directory: it
//! can be anywhere, one mode protects it from other users, and removing it removes everything.
//!
//! iceoryx2 accepts a variant as a list of its own building blocks. Later versions do not guarantee that a
//! variant may come from outside of the crate, so the version is pinned.

use std::fmt::Debug;

use iceoryx2::prelude::ZeroCopySend;
use iceoryx2::service::{Service, internal::ServiceInternal, ipc};
use iceoryx2_bb_elementary_traits::testing::abandonable::Abandonable;
use iceoryx2_cal::resizable_shared_memory::dynamic::DynamicMemory;
use iceoryx2_cal::shared_memory::file::Memory;
use iceoryx2_cal::shm_allocator::bump_allocator::BumpAllocator;
use iceoryx2_cal::shm_allocator::pool_allocator::PoolAllocator;
use iceoryx2_cal::{arc_sync_policy, dynamic_storage, zero_copy_connection};

/// iceoryx2 variant with memory in files, for communication between processes; each port is used by one thread.
#[derive(Debug, Clone)]
pub struct Ipc {}

impl ServiceInternal<Ipc> for Ipc {}

impl Service for Ipc {
    type PersistentDynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> =
        dynamic_storage::file::Storage<T>;
    type DynamicStorage<T: Debug + Send + Sync + ZeroCopySend + 'static> =
        dynamic_storage::file::Storage<T>;
    type SharedMemory = Memory<PoolAllocator>;
    type ResizableSharedMemory = DynamicMemory<PoolAllocator, Memory<PoolAllocator>>;
    type Connection = zero_copy_connection::file::Connection;
    type BlackboardMgmt<T: Send + Sync + Debug + ZeroCopySend + 'static> =
        dynamic_storage::file::Storage<T>;
    type BlackboardPayload = Memory<BumpAllocator>;

    // As in the standard variant.
    type StaticStorage = <ipc::Service as Service>::StaticStorage;
    type ConfigSerializer = <ipc::Service as Service>::ConfigSerializer;
    type Bag = <ipc::Service as Service>::Bag;
    type ServiceNameHasher = <ipc::Service as Service>::ServiceNameHasher;
    type Event = <ipc::Service as Service>::Event;
    type Monitoring = <ipc::Service as Service>::Monitoring;
    type Reactor = <ipc::Service as Service>::Reactor;
    type ArcThreadSafetyPolicy<T: Send + Debug + Abandonable> =
        arc_sync_policy::single_threaded::SingleThreaded<T>;
    type UniqueId = <ipc::Service as Service>::UniqueId;
}
