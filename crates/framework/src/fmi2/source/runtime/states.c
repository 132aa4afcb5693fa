/* Saved states: slots that a master names by a number, and bytes that it may keep. */

/* A free slot with room for a state, or NULL. A slot whose generations are used up is not used again: a number never
 * names two states. */
static Slot *make_slot(Instance *instance) {
    size_t k = 0;
    for (;;) {
        while (k < instance->slot_count) {
            Slot *slot = &instance->slots[k];
            if (slot->saved == NULL && slot->generation < SIZE_MAX >> SLOT_BITS) {
                slot->saved = snapshot_room(instance, k);
                slot->generation += slot->saved != NULL;
                return slot->saved != NULL ? slot : NULL;
            }
            k++;
        }
        if (!add_slots(instance)) {
            return NULL;
        }
    }
}

/* The number of a slot's state: never 0, and never an address. */
static void *name_of_slot(const Instance *instance, const Slot *slot) {
    size_t index = (size_t)(slot - instance->slots);
    return (void *)(uintptr_t)((slot->generation ^ instance->salt) << SLOT_BITS | (index + 1));
}

/* The slot of a saved state; NULL, refused, where there is none of this name. */
static Slot *find_slot(Call *call, void *name) {
    Instance *instance = call->instance;
    size_t number = (size_t)(uintptr_t)name, index = (number & (((size_t)1 << SLOT_BITS) - 1)) - 1;
    if (index < instance->slot_count) {
        Slot *slot = &instance->slots[index];
        if (slot->saved != NULL && (slot->generation ^ instance->salt) == number >> SLOT_BITS) {
            return slot;
        }
    }
    refused(call, ": this is not a saved state of this instance (never was, or freed before)");
    return NULL;
}

static Status refused_for_room(Call *call) {
    return refused(call, ": there is no room for another saved state: free some");
}

static Status get_state(Call *call, void **name) {
    Instance *instance = call->instance;
    Slot *slot = *name != NULL ? find_slot(call, *name) : make_slot(instance);
    if (slot == NULL) {
        return *name != NULL ? STATUS_ERROR : refused_for_room(call);
    }
    slot->saved->block = instance->block;
    slot->saved->phase = instance->phase;
    slot->saved->has_stop_time = instance->has_stop_time;
    slot->saved->stop_time = instance->stop_time;
    *name = name_of_slot(instance, slot);
    return STATUS_OK;
}

static Status set_state(Call *call, void *name) {
    Instance *instance = call->instance;
    const Slot *slot = find_slot(call, name);
    if (slot == NULL) {
        return STATUS_ERROR;
    }
    instance->block = slot->saved->block;
    instance->phase = slot->saved->phase;
    instance->has_stop_time = slot->saved->has_stop_time;
    instance->stop_time = slot->saved->stop_time;
    instance->fresh = 0;
#if UNIT_FMI == 3 && UNIT_INDICATORS > 0
    find_indicators(instance, instance->indicators);
#endif
    return STATUS_OK;
}

static Status free_state(Call *call, void **name) {
    if (name == NULL || *name == NULL) {
        return STATUS_OK;
    }
    Slot *slot = find_slot(call, *name);
    if (slot == NULL) {
        return STATUS_ERROR;
    }
    forget(call->instance, slot);
    *name = NULL;
    return STATUS_OK;
}

/* A state as bytes: magic, version, checksum, identity, phase, stop time with its flag, the numbers of reals and of
 * integers, and these. The least significant byte comes first. */
enum {
    OFFSET_VERSION = 8,
    OFFSET_CHECKSUM = OFFSET_VERSION + 4,
    OFFSET_IDENTITY = OFFSET_CHECKSUM + 4,
    OFFSET_PHASE = OFFSET_IDENTITY + 16,
    OFFSET_HAS_STOP_TIME = OFFSET_PHASE + 1,
    OFFSET_STOP_TIME = OFFSET_HAS_STOP_TIME + 1,
    OFFSET_SIZES = OFFSET_STOP_TIME + 8,
    OFFSET_REALS = OFFSET_SIZES + 16,
    OFFSET_INTEGERS = OFFSET_REALS + (int)sizeof(real) * UNIT_REALS,
    SERIALISED_SIZE = OFFSET_INTEGERS + 4 * UNIT_INTEGERS,
    FORMAT_VERSION = 1
};
static const char state_magic[8] = {'A', 'F', 'M', 'U', 'S', 'T', 'A', 'T'};
/* Which states belong together: those of one unit and interface, of the same sources. */
static const unsigned char state_identities[2][16] = UNIT_IDENTITY;

static uint32_t checksum(const unsigned char *bytes, size_t count) {
    uint32_t sum = 0xFFFFFFFFU;
    for (size_t k = 0; k < count; k++) {
        sum ^= bytes[k];
        for (int bit = 0; bit < 8; bit++) {
            sum = sum >> 1 ^ (sum & 1 ? 0xEDB88320U : 0);
        }
    }
    return ~sum;
}

static void put_bytes(unsigned char *bytes, uint64_t value, size_t count) {
    for (size_t k = 0; k < count; k++) {
        bytes[k] = (unsigned char)(value >> 8 * k & 0xFF);
    }
}

static uint64_t take_bytes(const unsigned char *bytes, size_t count) {
    uint64_t value = 0;
    for (size_t k = 0; k < count; k++) {
        value |= (uint64_t)bytes[k] << 8 * k;
    }
    return value;
}

#ifdef UNIT_FLOAT
typedef uint32_t RealBits;
#else
typedef uint64_t RealBits;
#endif

static Status serialised_size(Call *call, void *name, size_t *size) {
    if (find_slot(call, name) == NULL) {
        return STATUS_ERROR;
    }
    *size = SERIALISED_SIZE;
    return STATUS_OK;
}

static Status serialise(Call *call, void *name, unsigned char *bytes, size_t size) {
    const Slot *slot = find_slot(call, name);
    if (slot == NULL) {
        return STATUS_ERROR;
    }
    if (size < SERIALISED_SIZE) {
        text_add(why(call), ": ");
        text_integer(&call->why, (long long)size);
        text_add(&call->why, " bytes are given, ");
        text_integer(&call->why, SERIALISED_SIZE);
        text_add(&call->why, " needed");
        return STATUS_ERROR;
    }
    const Snapshot *saved = slot->saved;
    uint64_t stop_time = 0;
    memcpy(&stop_time, &saved->stop_time, sizeof stop_time);
    memcpy(bytes, state_magic, sizeof state_magic);
    put_bytes(bytes + OFFSET_VERSION, FORMAT_VERSION, 4);
    memcpy(bytes + OFFSET_IDENTITY, state_identities[call->instance->interface], 16);
    bytes[OFFSET_PHASE] = (unsigned char)saved->phase;
    bytes[OFFSET_HAS_STOP_TIME] = saved->has_stop_time != 0;
    put_bytes(bytes + OFFSET_STOP_TIME, stop_time, 8);
    put_bytes(bytes + OFFSET_SIZES, UNIT_REALS, 8);
    put_bytes(bytes + OFFSET_SIZES + 8, UNIT_INTEGERS, 8);
    for (size_t k = 0; k < UNIT_REALS; k++) {
        RealBits bits;
        memcpy(&bits, &saved->block.v[k], sizeof bits);
        put_bytes(bytes + OFFSET_REALS + k * sizeof bits, bits, sizeof bits);
    }
    for (size_t k = 0; k < UNIT_INTEGERS; k++) {
        put_bytes(bytes + OFFSET_INTEGERS + 4 * k, (uint32_t)saved->block.n[k], 4);
    }
    put_bytes(bytes + OFFSET_CHECKSUM, checksum(bytes + OFFSET_IDENTITY, SERIALISED_SIZE - OFFSET_IDENTITY), 4);
    return STATUS_OK;
}

static int integer_at(const unsigned char *bytes, int place) {
    int value;
    uint32_t bits = (uint32_t)take_bytes(bytes + OFFSET_INTEGERS + 4 * place, 4);
    memcpy(&value, &bits, sizeof value);
    return value;
}

static double stop_time_of(const unsigned char *bytes) {
    double stop_time;
    uint64_t bits = take_bytes(bytes + OFFSET_STOP_TIME, 8);
    memcpy(&stop_time, &bits, sizeof stop_time);
    return stop_time;
}

/* Whether an instance of this interface may be saved in a phase. */
static int is_phase_of(Interface interface, unsigned char phase) {
    int is_exchange = (phase == PHASE_EVENT && UNIT_FMI == 2) || phase == PHASE_CONTINUOUS_TIME;
    int is_stepped = phase == PHASE_STEP_COMPLETE || phase == PHASE_STEP_FAILED;
    return phase < PHASES && !(interface == CO_SIMULATION ? is_exchange : is_stepped);
}

/* Refuses integers that no instance has. A parameter that waits to be taken over may be beyond its limits: it is refused
 * then. */
static int check_integers(Call *call, const unsigned char *bytes) {
    int any_waits = UNIT_INTEGERS > 0 && integer_at(bytes, AT_PARAMETERS_SET) == 1;
    for (int place = 0; place < UNIT_INTEGERS; place++) {
        const IntegerVariable *variable = &unit_integer_variables[place];
        int value = integer_at(bytes, place);
        int is_parameter = place >= FIRST_INTEGER_PARAMETER && place - FIRST_INTEGER_PARAMETER < UNIT_INTEGER_PARAMETERS;
        int waits = any_waits && is_parameter && variable->type == TYPE_INTEGER && variable->items == NULL;
        if (!variable->has_limits || waits || (value >= variable->min && value <= variable->max)) {
            continue;
        }
        text_add(why(call), ": corrupted: ");
        if (variable->access != ACCESS_HIDDEN) {
            text_add(&call->why, variable->name);
        } else {
            text_add(&call->why, "internal value ");
            text_integer(&call->why, place);
        }
        text_add(&call->why, " = ");
        text_integer(&call->why, value);
        text_add(&call->why, ": must be within ");
        text_integer(&call->why, variable->min);
        text_add(&call->why, " … ");
        text_integer(&call->why, variable->max);
        return 0;
    }
    return 1;
}

/* Whether these are bytes of a state of this unit and interface. */
static int check_bytes(Call *call, const unsigned char *bytes, size_t size) {
    const char *reason = NULL;
    if (size != SERIALISED_SIZE) {
        text_add(why(call), ": ");
        text_integer(&call->why, (long long)size);
        text_add(&call->why, " bytes; a state of this FMU has ");
        text_integer(&call->why, SERIALISED_SIZE);
        return 0;
    }
    if (memcmp(bytes, state_magic, sizeof state_magic) != 0) {
        reason = ": these are not bytes of a serialised state";
    } else if (take_bytes(bytes + OFFSET_VERSION, 4) != FORMAT_VERSION) {
        reason = ": written in another format";
    } else if (take_bytes(bytes + OFFSET_CHECKSUM, 4) != checksum(bytes + OFFSET_IDENTITY, SERIALISED_SIZE - OFFSET_IDENTITY)) {
        reason = ": corrupted: the checksum does not fit";
    } else if (memcmp(bytes + OFFSET_IDENTITY, state_identities[call->instance->interface], 16) != 0) {
        reason = ": a state of another FMU, of another version of this one, or of its other interface";
    } else if (!is_phase_of(call->instance->interface, bytes[OFFSET_PHASE])) {
        reason = ": corrupted: no such phase";
    } else if (take_bytes(bytes + OFFSET_SIZES, 8) != UNIT_REALS || take_bytes(bytes + OFFSET_SIZES + 8, 8) != UNIT_INTEGERS) {
        reason = ": corrupted: its sizes are not those of this FMU";
    } else if (bytes[OFFSET_HAS_STOP_TIME] > 1 || (bytes[OFFSET_HAS_STOP_TIME] == 1 && !isfinite(stop_time_of(bytes)))) {
        reason = ": corrupted: its stop time is none";
    } else {
        /* Nothing is wrong with them. */
    }
    if (reason != NULL) {
        refused(call, reason);
    }
    return reason == NULL && check_integers(call, bytes);
}

static Status deserialise(Call *call, const unsigned char *bytes, size_t size, void **name) {
    if (!check_bytes(call, bytes, size)) {
        return STATUS_ERROR;
    }
    Slot *slot = make_slot(call->instance);
    if (slot == NULL) {
        return refused_for_room(call);
    }
    Snapshot *saved = slot->saved;
    saved->phase = (Phase)bytes[OFFSET_PHASE];
    saved->has_stop_time = bytes[OFFSET_HAS_STOP_TIME];
    saved->stop_time = stop_time_of(bytes);
    for (size_t k = 0; k < UNIT_REALS; k++) {
        RealBits bits = (RealBits)take_bytes(bytes + OFFSET_REALS + k * sizeof bits, sizeof bits);
        memcpy(&saved->block.v[k], &bits, sizeof bits);
    }
    for (int k = 0; k < UNIT_INTEGERS; k++) {
        saved->block.n[k] = integer_at(bytes, k);
    }
    *name = name_of_slot(call->instance, slot);
    return STATUS_OK;
}
