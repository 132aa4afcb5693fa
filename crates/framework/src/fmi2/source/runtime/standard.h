/* What of a standard the rest of the runtime needs: types of the master's, and the words of messages. UNIT_FMI is 2 in FMUs of
 * FMI 2.0, and 3 in those of FMI 3.0. */

#ifndef ADAPTIVE_FMU_STANDARD_H
#define ADAPTIVE_FMU_STANDARD_H

#if UNIT_FMI == 3
#include "fmi3.h"
typedef fmi3Status MasterStatus;
typedef fmi3Boolean MasterBoolean;
typedef fmi3Byte MasterByte;
typedef fmi3ValueReference Reference;
typedef fmi3Int32 Order;
typedef fmi3LogMessageCallback Logger;
#define FMI_FUNCTION(name, name_3) FMI3_FUNCTION(fmi3Status, fmi3##name_3)
#define FMI "fmi3"
#define SETUP_EXPERIMENT "fmi3EnterInitializationMode"
#define NEW_DISCRETE_STATES "fmi3UpdateDiscreteStates"
#define TOKEN_ARGUMENT "instantiationToken"
#define TOKEN "the instantiation token"
#else
#include "fmi2.h"
typedef fmi2Status MasterStatus;
typedef fmi2Boolean MasterBoolean;
typedef fmi2Byte MasterByte;
typedef fmi2ValueReference Reference;
typedef fmi2Integer Order;
typedef fmi2CallbackLogger Logger;
#define FMI_FUNCTION(name, name_3) FMI2_FUNCTION(fmi2Status, fmi2##name)
#define FMI "fmi2"
#define SETUP_EXPERIMENT "fmi2SetupExperiment"
#define NEW_DISCRETE_STATES "fmi2NewDiscreteStates"
#define TOKEN_ARGUMENT "fmuGUID"
#define TOKEN "the GUID"
#endif

/* Answers to a call, with the numbers that they have in both standards. */
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR } Status;
/* Which of the standard's two interfaces an instance was made for. */
typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Interface;

/* What an instance has of its master. */
typedef struct {
    void *environment;
    Logger logger; /* or NULL */
    void *(*allocate)(size_t count, size_t size); /* NULL, both of them, in FMI 3.0 and where a master has none */
    void (*release)(void *memory);
} Master;

#endif
