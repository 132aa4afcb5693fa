/* Memory of instances and of saved states: from the master, or, with UNIT_STATIC_INSTANCES, from a pool of so many
 * instances, and nothing is allocated. The pool is no matter of threads: instances from it are made by one of them. */

/* Slots are named by so many bits; generations by the rest. */
enum { SLOT_BITS = 16 };

/* A number that differs from instance to instance. */
static size_t salt_of(const Instance *instance) {
    size_t mixed = (size_t)(uintptr_t)instance / 16 * 2654435761U;
#ifndef UNIT_STATIC_INSTANCES
    /* Another instance may have had this address before. In a pool generations go on. */
    mixed ^= (size_t)clock() * 2246822519U ^ (size_t)time(NULL) * 3266489917U;
#endif
    return mixed >> SLOT_BITS;
}

#ifdef UNIT_STATIC_INSTANCES

static Instance instance_pool[UNIT_STATIC_INSTANCES];

static Instance *make_instance(const Master *master, const char *name) {
    for (int k = 0; k < UNIT_STATIC_INSTANCES; k++) {
        Instance *instance = &instance_pool[k];
        if (instance->name != NULL) {
            continue;
        }
        instance->master = *master;
        instance->name = instance->name_room;
        strncpy(instance->name, name, UNIT_STATIC_NAME - 1);
        instance->slots = instance->slot_room;
        instance->slot_count = UNIT_STATIC_STATES;
        instance->log.count = instance->log.sent = instance->log.left_out = 0;
        instance->is_freed = 0;
        return instance;
    }
    return NULL;
}

static void forget(Instance *instance, Slot *slot) {
    (void)instance;
    slot->saved = NULL;
}

static void release(Instance *instance) {
    for (size_t k = 0; k < instance->slot_count; k++) {
        forget(instance, &instance->slots[k]);
    }
    instance->name = NULL;
}

static int add_slots(Instance *instance) {
    (void)instance;
    return 0;
}

static Snapshot *snapshot_room(Instance *instance, size_t slot) {
    return &instance->snapshots[slot];
}

#else

/* Memory of zeros, or NULL. */
static void *allocate(const Master *master, size_t size) {
    int masters = master->allocate != NULL && master->release != NULL;
    void *memory = masters ? master->allocate(1, size) : malloc(size);
    return memory != NULL ? memset(memory, 0, size) : NULL;
}

static void give_back(const Master *master, void *memory) {
    int masters = master->allocate != NULL && master->release != NULL;
    if (memory == NULL) {
        return;
    }
    if (masters) {
        master->release(memory);
    } else {
        free(memory);
    }
}

static Instance *make_instance(const Master *master, const char *name) {
    size_t length = strlen(name) + 1;
    Instance *instance = allocate(master, sizeof *instance);
    char *kept = allocate(master, length);
    if (instance == NULL || kept == NULL) {
        give_back(master, instance);
        give_back(master, kept);
        return NULL;
    }
    instance->master = *master;
    instance->name = memcpy(kept, name, length);
    return instance;
}

static void forget(Instance *instance, Slot *slot) {
    give_back(&instance->master, slot->saved);
    slot->saved = NULL;
}

static void release(Instance *instance) {
    Master master = instance->master;
    for (size_t k = 0; k < instance->slot_count; k++) {
        forget(instance, &instance->slots[k]);
    }
    give_back(&master, instance->slots);
    give_back(&master, instance->name);
    give_back(&master, instance);
}

static int add_slots(Instance *instance) {
    size_t most = ((size_t)1 << SLOT_BITS) - 1, before = instance->slot_count;
    size_t count = before == 0 ? 4 : before < most / 2 ? 2 * before : most;
    Slot *slots = count > before ? allocate(&instance->master, count * sizeof *slots) : NULL;
    if (slots == NULL) {
        return 0;
    }
    if (before > 0) {
        memcpy(slots, instance->slots, before * sizeof *slots);
    }
    give_back(&instance->master, instance->slots);
    instance->slots = slots;
    instance->slot_count = count;
    return 1;
}

static Snapshot *snapshot_room(Instance *instance, size_t slot) {
    (void)slot;
    return allocate(&instance->master, sizeof(Snapshot));
}

#endif
